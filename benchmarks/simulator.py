"""The simulator of docs/abr.md against the namespace lab: the same controllers, movement and traces, in both.

    sudo .venv/bin/python -m benchmarks.simulator [NETWORK ...] [--controllers NAME ...] [--out DIR] [--most N]

NETWORK is a trace's file in any format, or FILE,20ms-rtt, which replaces its delay. The lab's runs come first, each
into a folder of its own; one that is complete is kept, so that what was interrupted goes on, and `--most` makes so many
in one go. Four of them have a link that takes next to nothing and a fixed rung: what a frame takes there beyond the
server's own time is the page's. Then the simulator plays the same part of each trace, with the server's time and the
page's animation frames of that very run and the sizes of its views, and a table and a plot say how the two differ.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import shutil
import statistics
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from matplotlib.figure import Figure
from prometheus_client.parser import text_string_to_metric_families

from tigas_common.errors import StartError, TigasError
from tigas_common.wire.recording import Input, Lens
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest
from tigas_common.wire.run import Configuration, Network
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.summary import Records, figures
from tigas_experiments.run.environment import open_environment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.measure import run
from tigas_experiments.run.parsing import parse_network
from tigas_experiments.run.targets import LAB_URL
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.formats import load_trace

ROOT = Path(__file__).parent.parent
NETWORKS = [str(ROOT / "traces/network" / name) for name in ("4g-bus.csv", "dsl.csv,20ms-rtt", "step-down.csv")]
SCENE, WIDTH, HEIGHT = "courtyard", 640, 360
VIEW_EVERY_MS = 500
FAST = "t_ms,down_kbps,up_kbps\n0,200000,200000\n1000,,\n"
"""A link that takes next to nothing."""
FAST_SECONDS = 10
STAGES = ("queue", "render", "encode")
FIGURES = {
    "photon p50, ms": "photonP50",
    "p95, ms": "photonP95",
    "poses ≤ 100 ms, %": "inTime",
    "mean rung": "rungOverTime",
    "switches/min": "switches",
    "frames/s": "framesPerSecond",
    "Mbit/s": "bandwidth",
}


@dataclass(frozen=True, slots=True)
class Server:
    """What the render service counted while a run was made."""

    frames: float
    seconds: dict[str, float]
    """Of all frames together, by stage."""

    @classmethod
    async def read(cls) -> Server:
        """Until now."""
        async with httpx.AsyncClient(base_url=LAB_URL, trust_env=False) as http:
            text = (await http.get("/metrics")).text
        samples = [sample for family in text_string_to_metric_families(text) for sample in family.samples]
        seconds = dict.fromkeys(STAGES, 0.0)
        frames = 0.0
        for sample in samples:
            if sample.name == "tigas_frame_seconds_sum":
                seconds[sample.labels["stage"]] = sample.value
            if sample.name == "tigas_frame_seconds_count":
                frames = sample.value
        return cls(frames, seconds)

    def since(self, before: Server) -> dict[str, float]:
        """Frames, and milliseconds of the mean one."""
        frames = self.frames - before.frames
        spent = {stage: 1000 * (self.seconds[stage] - before.seconds[stage]) / max(1, frames) for stage in STAGES}
        return {"frames": frames, **spent}


@dataclass(frozen=True, slots=True)
class Plan:
    """All runs, and where they go."""

    runs: Sequence[Configuration]
    fast: Sequence[Configuration]
    """Over the fast link, one for each rung."""
    out: Path

    def folder(self, configuration: Configuration) -> Path:
        """Of one run."""
        return self.out / "runs" / configuration.slug

    @property
    def missing(self) -> list[Configuration]:
        """The runs that are to be made."""
        return [one for one in (*self.runs, *self.fast) if not self.complete(one)]

    def complete(self, configuration: Configuration) -> bool:
        """Whether it was made."""
        return (self.folder(configuration) / "server.json").exists()

    @property
    def views(self) -> Path:
        """What each rung takes, alone on the machine."""
        return self.out / "views.json"


async def measure(plan: Plan, most: int) -> None:
    """Make the runs that are missing, at most so many."""
    if not plan.missing and plan.views.exists():
        return
    async with open_environment(None, None, None, Inputs(Path())) as environment:
        await environment.check(plan.runs)
        for configuration in plan.missing[:most]:
            folder = plan.folder(configuration)
            shutil.rmtree(folder, ignore_errors=True)
            print(f"{folder.name} …", flush=True)
            before = await Server.read()
            record = await run(environment, configuration, folder, lambda _: None)
            if record.status != "complete":
                raise TigasError(f"{folder.name}: {record.problem}")
            (folder / "server.json").write_text(json.dumps((await Server.read()).since(before)))
        if not plan.missing and not plan.views.exists():
            plan.views.write_text(json.dumps(await measure_views(StoredRun(plan.folder(plan.runs[0])))))


async def measure_views(stored: StoredRun) -> dict[str, Any]:
    """Each rung along the movement, one frame after another: bytes, and the server's milliseconds."""
    assert stored.record.recording is not None
    lens = stored.record.recording.lens
    inputs = stored.inputs()
    poses = [next(pose for pose in inputs if pose.at >= at) for at in range(0, int(inputs[-1].at), VIEW_EVERY_MS)]
    print(f"{len(poses)} views at each rung …", flush=True)
    async with httpx.AsyncClient(base_url=LAB_URL, trust_env=False, timeout=30) as http:
        frames = [
            [await render(http, pose, lens, rung) for rung in range(len(DEFAULT_LADDER))] for pose in [poses[0], *poses]
        ][1:]  # the first ones warm it up
    return {
        "rungs": [
            {
                "render_ms": statistics.mean(timing["render"] for _, timing in of_rung),
                "encode_ms": statistics.mean(timing["encode"] for _, timing in of_rung),
            }
            for of_rung in zip(*frames, strict=True)
        ],
        "views": [
            {"t_ms": max(0.0, pose.at), "bytes": [len(image) for image, _ in rungs]}
            for pose, rungs in zip(poses, frames, strict=True)
        ],
    }


async def render(http: httpx.AsyncClient, pose: Input, lens: Lens, rung: int) -> tuple[bytes, dict[str, float]]:
    """One JPEG, and where the server's milliseconds went."""
    request = RenderRequest.at(SCENE, pose.camera, lens.intrinsics, profile=rung)
    answer = await http.post("/render", content=request.model_dump_json(exclude_none=True))
    answer.raise_for_status()
    timing = dict(part.strip().split(";dur=") for part in answer.headers["Server-Timing"].split(","))
    return answer.content, {stage: float(value) for stage, value in timing.items()}


def slowdown(stored: StoredRun, server: dict[str, float], alone: dict[str, Any]) -> float:
    """How many times longer the server took for a frame of the run than it does alone, at the rungs that were shown."""
    shown = Counter(frame.rung for frame in stored.frames())
    expected = sum(
        count * (alone["rungs"][rung]["render_ms"] + alone["rungs"][rung]["encode_ms"])
        for rung, count in shown.items()
        if rung is not None
    )
    return (server["render"] + server["encode"]) * shown.total() / float(expected)


def endpoints(stored: StoredRun, server: dict[str, float], alone: dict[str, Any], page: Sequence[float]) -> object:
    """What abr-sim's --measured reads; `page` has the milliseconds that a frame of each rung takes besides."""
    factor = slowdown(stored, server, alone)
    return {
        "rungs": [
            {"render_ms": rung["render_ms"] * factor, "encode_ms": rung["encode_ms"] * factor, "page_ms": page_ms}
            for rung, page_ms in zip(alone["rungs"], page, strict=True)
        ],
        "views": alone["views"],
        "animation": [
            {"t_ms": later.at, "turning": angle(earlier, later) * 1000 / (later.at - earlier.at)}
            for earlier, later in pairwise(stored.inputs())
        ],
    }


def angle(earlier: Input, later: Input) -> float:
    """Degrees between two poses."""
    return math.degrees(2 * math.acos(min(1.0, abs(float(np.dot(earlier.quaternion, later.quaternion))))))


def simulated(plan: Plan, configuration: Configuration, page: Sequence[float]) -> dict[str, float]:
    """All figures that the simulator has of a run."""
    folder, network = plan.folder(configuration), configuration.network
    stored = StoredRun(folder)
    server = json.loads((folder / "server.json").read_text())
    measured, told = folder / "endpoints.json", folder / "simulated.json"
    measured.write_text(json.dumps(endpoints(stored, server, json.loads(plan.views.read_text()), page)))
    profile = configuration.profile
    options = {
        "controller": f"fixed:{profile}" if isinstance(profile, int) else profile,
        "seconds": str(configuration.duration_s),
        "measured": str(measured.resolve()),
        "json": str(told.resolve()),
        **({} if network.rtt_ms is None else {"rtt": str(network.rtt_ms)}),
    }
    flags = [part for name, value in options.items() for part in (f"--{name}", value)]
    assert network.trace_file is not None
    subprocess.run(
        ["node", "scripts/abr-sim.mjs", *flags, str(network.trace_file.resolve())],
        cwd=ROOT / "web", check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    (only,) = json.loads(told.read_text())["runs"]
    found: dict[str, float] = only["figures"]
    return found


def page_time(plan: Plan, configuration: Configuration) -> float:
    """Milliseconds that a frame takes over the fast link, from its pose to the screen, and not in the simulator."""
    simulator = simulated(plan, configuration, [0.0] * len(DEFAULT_LADDER))["age"]
    frames = StoredRun(plan.folder(configuration)).frames()
    return max(0.0, statistics.mean(min(frame.latencies) for frame in frames if frame.latencies) - simulator)


def seen(stored: StoredRun) -> dict[str, float]:
    """The lab's figures of a run, under the same names."""
    found = figures(Records.of(stored))
    configuration = stored.record.configuration
    values = (
        found.latencies.p50,
        found.latencies.p95,
        100 * (found.latencies.share_interactive or 0),
        sum(rung * share for rung, share in found.rungs.share.items()),
        found.rungs.switches / configuration.duration_s * 60,
        found.frames.per_s,
        (found.received_kbps or 0) / 1000,
    )
    return {name: math.nan if value is None else value for name, value in zip(FIGURES, values, strict=True)}


def report(plan: Plan) -> None:
    """Simulate every run, print a table and draw a plot."""
    page = [page_time(plan, configuration) for configuration in plan.fast]
    pairs: list[tuple[Configuration, dict[str, float], dict[str, float]]] = []
    print(f"\n| trace | controller | | {' | '.join(FIGURES)} |\n|---|---|---|{'---:|' * len(FIGURES)}")
    for configuration in plan.runs:
        lab, told = seen(StoredRun(plan.folder(configuration))), simulated(plan, configuration, page)
        simulator = {name: told[key] * (100 if key == "inTime" else 1) for name, key in FIGURES.items()}
        pairs.append((configuration, lab, simulator))
        for name, values in (("lab", lab), ("simulator", simulator)):
            cells = " | ".join(f"{value:.{0 if 'ms' in title else 1}f}" for title, value in values.items())
            print(f"| {Path(configuration.network.name).stem} | {configuration.profile} | {name} | {cells} |")
    print("\nserver, mean of a frame of the run, and how many times that is what it takes alone; page; machine")
    alone = json.loads(plan.views.read_text())
    for configuration in (*plan.runs, *plan.fast):
        stored = StoredRun(plan.folder(configuration))
        server = json.loads((plan.folder(configuration) / "server.json").read_text())
        gaps = [later.at - earlier.at for earlier, later in pairwise(stored.inputs())]
        load = stored.record.load
        print(
            f"{plan.folder(configuration).name}: {server['frames']:.0f} frames, "
            + ", ".join(f"{stage} {server[stage]:.1f} ms" for stage in STAGES)
            + f", ×{slowdown(stored, server, alone):.2f}; animation frames {1000 / statistics.mean(gaps):.1f}/s; "
            + (f"processors {100 * load.cpu_mean:.0f} % busy" if load else "")
        )
    for number, (rung, page_ms) in enumerate(zip(alone["rungs"], page, strict=True)):
        print(f"rung {number}: render {rung['render_ms']:.1f}, encode {rung['encode_ms']:.1f}, page {page_ms:.1f} ms")
    plot(pairs, plan.out / "simulator.svg")


def plot(pairs: Sequence[tuple[Configuration, dict[str, float], dict[str, float]]], path: Path) -> None:
    """The simulator's figures over the lab's: a point a run, on the diagonal where they agree."""
    colours = {profile: f"C{i}" for i, profile in enumerate(dict.fromkeys(one.profile for one, _, _ in pairs))}
    marks = dict(zip(dict.fromkeys(one.network.name for one, _, _ in pairs), "osDv^<>", strict=False))
    figure = Figure(figsize=(14, 4.6), layout="constrained")
    axes = list(figure.subplots(2, 4).flat)
    for axis, title in zip(axes, FIGURES, strict=False):
        for one, lab, simulator in pairs:
            label = f"{Path(one.network.name).stem}, {one.profile}"
            mark, colour = marks[one.network.name], colours[one.profile]
            axis.plot(lab[title], simulator[title], mark, color=colour, label=label, alpha=0.8)
        end = 1.05 * max(1e-9, *(value for _, *both in pairs for each in both if (value := each[title]) == value))
        axis.plot((0, end), (0, end), color="grey", linewidth=0.8, zorder=0)
        axis.set(title=title, xlim=(0, end), ylim=(0, end))
    axes[-1].axis("off")
    axes[-1].legend(*axes[0].get_legend_handles_labels(), loc="center", frameon=False, fontsize=8)
    figure.supxlabel("lab")
    figure.supylabel("simulator")
    figure.savefig(path)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="*", default=NETWORKS, metavar="NETWORK")
    parser.add_argument(
        "--controllers", nargs="+", default=["latency", "latency-transfer", "budget", "2"], metavar="NAME|RUNG"
    )
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--out", type=Path, default=Path("results/simulator"))
    parser.add_argument(
        "--most", type=int, default=1000, help="make at most so many of the lab's runs, and go on later"
    )
    arguments = parser.parse_args()
    (arguments.out / "traces").mkdir(parents=True, exist_ok=True)
    try:
        traces = arguments.out / "traces"
        fast = Network(trace="fast.csv", trace_file=traces / "fast.csv")
        (traces / "fast.csv").write_text(FAST)

        def configuration(network: Network, profile: int | str, seconds: float) -> Configuration:
            return Configuration(
                scene=SCENE, movement="stroll", network=network, mode="stateless", profile=profile,
                duration_s=seconds, width=WIDTH, height=HEIGHT, capture_every_ms=0, warm_up_s=2,
            )  # fmt: skip

        plan = Plan(
            [
                configuration(converted(network, traces), int(name) if name.isdecimal() else name, arguments.seconds)
                for network in arguments.networks
                for name in arguments.controllers
            ],
            [configuration(fast, rung, FAST_SECONDS) for rung in range(len(DEFAULT_LADDER))],
            arguments.out,
        )
        asyncio.run(measure(plan, arguments.most))
    except (StartError, TigasError, BrokenRecording, ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    if plan.missing:
        print(f"{len(plan.missing)} of {len(plan.runs) + len(plan.fast)} runs are missing; the same command goes on.")
        return 3
    report(plan)
    return 0


def converted(text: str, folder: Path) -> Network:
    """A network of a trace's file, as the simulator reads it: in the project's own format. Raises ValueError."""
    network = parse_network(text)
    if network.trace_file is None:
        raise ValueError(f"{text!r} is no trace's file.")
    trace = load_trace(network.trace_file)
    path = folder / f"{trace.name}.csv"
    path.write_text(format_csv(trace), encoding="utf-8")
    return network.model_copy(update={"trace": path.name, "trace_file": path})


if __name__ == "__main__":
    sys.exit(main())
