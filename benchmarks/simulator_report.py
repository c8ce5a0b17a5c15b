"""The same runs in the simulator, and a table and a plot of how the two differ."""

from __future__ import annotations

import json
import math
import statistics
import subprocess
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.simulator_runs import STAGES, Plan
from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_common.wire.recording import Input
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_common.wire.run import Configuration
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.summary import Records, figures

ROOT = Path(__file__).parent.parent
FIGURES = {
    "photon p50, ms": "photonP50",
    "p95, ms": "photonP95",
    f"poses ≤ {INTERACTIVE_MS:g} ms, %": "inTime",
    "mean rung": "rungOverTime",
    "switches/min": "switches",
    "frames/s": "framesPerSecond",
    "Mbit/s": "bandwidth",
}
"""What is compared, and the simulator's name for it."""


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
