"""A made-up experiment: many small runs with known figures, to test the report.

python -m tests.experiments.report.synthetic_results DIR      # a large one, to look at: tigas report DIR
"""

from __future__ import annotations

import csv
import html.parser
import itertools
import json
import random
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.experiments.made_up import MACHINE, configuration, frame, inputs, recording, reply, sample
from tigas_experiments.quality.picture import CaptureQuality, Quality
from tigas_experiments.records.folder import RunRecord, RunWriter
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.run_table import load_results
from tigas_experiments.wire.recording import LinkSample, PlayedDownload, Recording, ShownFrame, Traffic
from tigas_experiments.wire.run import Mode, Network

STEP_MS = 20.0
"""Between inputs: 50 a second."""
HEIGHTS = (1080, 720, 480, 240)
SCENE_BYTES = 10_000_000


def write_run(
    folder: Path,
    controller: str | int = "latency",
    network: str = "bus",
    rtt_ms: float | None = 20.0,
    *,
    offset_s: float = 0.0,
    mode: Mode = "stateless",
    delay_ms: float = 40.0,
    reply_ms: float | None = None,
    jitter_ms: float = 0.0,
    rungs: Sequence[int] = (2,),
    hold: int = 10,
    every: int = 1,
    seconds: float = 2.0,
    kbps: float = 8000.0,
    link_kbps: float = 20_000.0,
    busy: float = 0.5,
    view_ssim: float = 0.8,
    local: PlayedDownload | None = None,
    **changes: Any,
) -> Path:
    """A run with every `every`th input shown `delay_ms` later, in these rungs in turn, each for `hold` frames.

    Every input's reply takes `reply_ms`, if replies are recorded. The page receives `kbps`. With `jitter_ms`, delays
    have a long tail, the same for the same folder's name.
    """
    duration = seconds * 1000
    chance = random.Random(folder.name)
    sampled = inputs(int(duration / STEP_MS), every_ms=STEP_MS)
    shown: list[ShownFrame] = []
    for number, entry in enumerate(sampled[every - 1 :: every]):
        rung = rungs[number // hold % len(rungs)]
        late = delay_ms + (chance.expovariate(1 / jitter_ms) if jitter_ms else 0.0)
        at = max(entry.at + late, shown[-1].at if shown else 0.0)
        shown_rung = rung if mode == "stateless" else None
        shown.append(frame(at, entry.pose, shown_rung, HEIGHTS[min(rung, len(HEIGHTS) - 1)]))
    made = Recording.model_validate(
        recording(
            mode="stateless" if mode == "stateless" else "dash" if local is None else "local",
            local=local,
            duration_ms=duration,
            ended_ms=duration + delay_ms,
            inputs=tuple(sampled),
            frames=tuple(shown),
            replies=() if reply_ms is None else tuple(reply(entry.at, reply_ms, entry.pose) for entry in sampled),
            traffic=tuple(Traffic(at=at, bytes=int(at * kbps / 8)) for at in _ticks(duration, 100)),
        ),
        strict=False,
    )
    link = Network(trace=network, rtt_ms=rtt_ms, offset_s=offset_s)
    record = RunRecord(
        configuration=configuration(mode, profile=controller, network=link, duration_s=seconds, **changes),
        machine=MACHINE,
        started="2026-01-01T00:00:00+00:00",
        scene_bytes=SCENE_BYTES,
    )
    writer = RunWriter(folder, record)
    writer.recording(made)
    machine = [LoadSample(unix_ms=1e12, cpu=busy, load_average=1.0)]
    measured = {"target_kbps": link_kbps, "drops": 0}
    writer.write(
        LinkSample, [sample(at, kbps).model_copy(update=measured | {"position_ms": at}) for at in _ticks(duration, 200)]
    )
    writer.write(LoadSample, machine)
    quality, view = Quality(psnr_db=30.0, ssim=0.9), Quality(psnr_db=20.0, ssim=view_ssim)
    writer.write(CaptureQuality, [CaptureQuality(at=500.0, pose=20, rung=2, picture=quality, view=view, seen=view)])
    writer.close(status="complete", browser="156", backend="netem", load=Load.summarise(machine), recording=made.head)
    return folder


def groups(folder: Path, *runs: dict[str, Any]) -> Groups:
    """Write runs, named 00, 01, …, and group them."""
    for number, run in enumerate(runs):
        write_run(folder / "runs" / f"{number:02}", **run)
    return Groups.from_runs(load_results(folder).runs)


def change(run: Path, **fields: Any) -> Path:
    """Change a run's record; fields of `load` are changed one by one."""
    path = run / "run.json"
    record = json.loads(path.read_text())
    if isinstance(changed := fields.get("load"), dict):
        fields["load"] = record["load"] | changed
    path.write_text(json.dumps(record | fields))
    return run


def download(first_s: float | None, complete_s: float | None, size: int = 2_000_000) -> PlayedDownload:
    """A download of a scene that began with the run."""
    return PlayedDownload(
        form="compressed",
        renderer="WebGL 2",
        began_ms=0,
        first_picture_ms=None if first_s is None else first_s * 1000,
        complete_ms=None if complete_s is None else complete_s * 1000,
        downloaded_bytes=size,
        bytes=size,
        gaussians=10_000,
    )


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def text_of(page: str) -> str:
    """The visible text, without styles and drawings."""
    parts: list[str] = []

    class Reader(html.parser.HTMLParser):
        def handle_data(self, data: str) -> None:
            parts.append(data)

    Reader().feed(page)
    return " ".join(" ".join(parts).split())


def _ticks(duration_ms: float, every_ms: float) -> list[float]:
    """From 0 to the duration."""
    return [index * every_ms for index in range(int(duration_ms / every_ms) + 1)]


def write_large(folder: Path, networks: Sequence[str], rtts: Sequence[float], repeats: int, seconds: float) -> int:
    """Write runs of six controllers and modes over networks and round trips; returns their number."""
    contenders: dict[str | int, dict[str, Any]] = {
        "latency": {"delay_ms": 90.0, "jitter_ms": 60.0, "rungs": (0, 1), "hold": 400, "every": 3, "kbps": 18_000.0},
        "seen": {"delay_ms": 35.0, "jitter_ms": 9.0, "rungs": (1, 2), "hold": 300, "kbps": 11_000.0},
        "lol+": {"delay_ms": 32.0, "jitter_ms": 12.0, "rungs": (3, 2), "hold": 30, "kbps": 5000.0},
        "l2a": {"delay_ms": 50.0, "jitter_ms": 25.0, "rungs": (0, 1, 2, 1), "hold": 90, "kbps": 15_000.0},
        2: {"delay_ms": 38.0, "jitter_ms": 14.0, "rungs": (2,), "kbps": 9000.0},
        "dash": {"mode": "dash-tuned", "delay_ms": 300.0, "jitter_ms": 30.0, "every": 2, "kbps": 3000.0},
    }
    numbers = itertools.count(1)
    for place, network in enumerate(networks):
        for rtt, (name, look), repeat in itertools.product(rtts, contenders.items(), range(repeats)):
            number = next(numbers)
            changed = {**look, "delay_ms": look["delay_ms"] + rtt * (2.5 if name == "latency" else 1.1) + 6 * repeat}
            profile = "seen" if name == "dash" else name
            run = folder / "runs" / f"{number:03}_{place}_{rtt:g}_{name}_{repeat}"
            write_run(run, profile, network, rtt, seconds=seconds, repeat=repeat, **changed)
    return next(numbers) - 1


if __name__ == "__main__":
    sys.exit(f"{write_large(Path(sys.argv[1]), ('4g-bus', 'dsl'), (20, 50, 100, 200, 300), 3, 20.0)} runs")
