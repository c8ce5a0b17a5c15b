"""What breaks cost a viewer of the modes stateless and video, from end to end: lost packets, and a killed engine.

    sudo .venv/bin/python -m benchmarks.recovery [--blocks 6]       (five minutes)

A page in headless Chromium looks around in a small made-up scene, at the lab's link (docs/network.md) and at a service
with two engines. At first nothing is lost; then 1 % of all packets are, in both directions; then nothing again, and the
engine that answers is killed. Each block is a part of the movement of its own, in which both modes play after one
another, in random order, at each round trip. Times come from what the page showed. Prints Markdown for docs/video.md.
"""

from __future__ import annotations

import asyncio
import math
import os
import random
import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import httpx
import numpy as np
import psutil
import torch
import typer

from tests.render.arrays import gaussians_of
from tigas_common.cli import in_a_sentence
from tigas_common.commit import this_commit
from tigas_common.errors import StartError
from tigas_common.wire.run import Configuration, Mode, Network
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.statistics import new_views, percentile
from tigas_experiments.report.blocks import Estimate
from tigas_experiments.run.browser import viewer
from tigas_experiments.run.environment import Environment, open_environment
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.link import held
from tigas_experiments.run.measure import page_settings, recorded
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.ply import write_ply

SCENE, TRACE = "made-up", "breaks.csv"
MODES: tuple[Mode, ...] = ("stateless", "video")
RTTS_MS = (20.0, 100.0)
RUNG, SIZE = 2, (640, 360)
"""Of the paper's ladder, and the viewport."""
GAUSSIANS = 4000
"""Few, so that two cores draw every frame in time, and an engine loads them at once."""
LOSSY_S, CLEAN_S, KILL_S, END_S = 2.0, 6.0, 6.8, 9.3
"""When losses begin and end, the engine is killed, and a run ends."""
MARGIN_S = 0.3
"""What the link may be late, which is no part of a stretch."""
LOOK_S = 0.5
"""For so long, the engine that is to be killed works visibly."""
START_S, POLL_S = 60.0, 0.2
"""How long an engine may take to start, and how often it is looked for."""
TRACE_TEXT = f"""t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct
0,20000,10000,0,0,0
{LOSSY_S * 1000:.0f},20000,10000,0,0,1
{CLEAN_S * 1000:.0f},20000,10000,0,0,0
60000,,,,,
"""
FIGURES = {
    "new views a second, nothing lost": "{:.1f}",
    "new views a second, 1 % lost": "{:.1f}",
    "picture stands still, nothing lost, p99, ms": "{:.0f}",
    "picture stands still, 1 % lost, p99, ms": "{:.0f}",
    "picture stands still, engine killed, ms": "{:.0f}",
}
"""How each is printed."""


@dataclass(frozen=True)
class Run:
    """What one mode showed in a block."""

    mode: Mode
    rtt_ms: float
    block: int
    figures: tuple[float, ...]
    """As FIGURES."""


def scene() -> Gaussians:
    """Coloured blobs in all directions."""
    chance = torch.Generator().manual_seed(1)
    directions = torch.nn.functional.normalize(torch.randn(GAUSSIANS, 3, generator=chance), dim=1)
    return gaussians_of(
        means=directions * (3 + 3 * torch.rand(GAUSSIANS, 1, generator=chance)),
        scales=0.03 + 0.2 * torch.rand(GAUSSIANS, 3, generator=chance),
        quaternions=torch.nn.functional.normalize(torch.randn(GAUSSIANS, 4, generator=chance), dim=1),
        opacities=torch.rand(GAUSSIANS, generator=chance),
        sh=torch.randn(GAUSSIANS, 1, 3, generator=chance),
    )


def figures(shown: Sequence[float], killed_ms: float, ended_ms: float) -> tuple[float, ...]:
    """FIGURES of a run, in which new views were shown at these times; all in ms since its start."""
    clean, lossy = (_between(shown, *stretch) for stretch in ((0.0, LOSSY_S), (LOSSY_S, CLEAN_S)))
    return (
        len(clean) / (LOSSY_S - 2 * MARGIN_S),
        len(lossy) / (CLEAN_S - LOSSY_S - 2 * MARGIN_S),
        percentile(_gaps(clean), 0.99) or math.inf,
        percentile(_gaps(lossy), 0.99) or math.inf,
        max(late - early for early, late in pairwise([*shown, ended_ms]) if late > killed_ms),
    )


async def measured(environment: Environment, configuration: Configuration) -> tuple[float, ...]:
    """One run, in which an engine is killed. Raises StartError, RunFailed and BrokenRecording."""
    setup = await environment.setup(configuration)
    assert setup.target.lab is not None
    url, lab = setup.target.url, setup.target.lab
    await _both_engines(url)
    async with (
        viewer(setup.browser, url, setup.scene.id, configuration.width, configuration.height) as page,
        held(setup.target, setup.network) as link,
    ):
        await page.prepare(page_settings(configuration), setup.points[0])
        await asyncio.sleep(configuration.warm_up_s)
        assert link is not None
        await link.play()
        killing = asyncio.create_task(_kill(lab))
        recording = await recorded(page, configuration, setup.points)
        shown = [frame.at for frame in new_views(recording.frames)]
        return figures(shown, await killing - recording.started_unix_ms, recording.ended_ms)


def table(runs: Sequence[Run]) -> Iterator[str]:
    """Means over blocks, and the ratio of video to stateless with its interval."""
    yield "| | round trip, ms | stateless | video | video / stateless |"
    yield "|---|---:|---:|---:|---:|"
    for column, (name, shown) in enumerate(FIGURES.items()):
        for rtt in RTTS_MS:
            by_mode = {
                mode: {run.block: run.figures[column] for run in runs if (run.mode, run.rtt_ms) == (mode, rtt)}
                for mode in MODES
            }
            one, other = (by_mode[mode] for mode in MODES)
            blocks = [block for block in one if block in other]
            if blocks:
                means = (float(np.mean([values[block] for block in blocks])) for values in (one, other))
                ratio = Estimate.over([math.log(other[block] / one[block]) for block in blocks])
                yield f"| {name} | {rtt:g} | {' | '.join(map(shown.format, means))} | {_ratio(ratio)} |"


async def run_all(folder: Path, blocks: int, seed: int) -> list[Run]:
    """All runs, one after another. Raises StartError."""
    chance, runs = random.Random(seed), list[Run]()
    for block in range(blocks):
        # Services of its own: an engine that ends more often than four times a minute is left alone for a while.
        async with open_environment(None, folder, None, Inputs(folder), ladder="paper") as environment:
            for rtt in chance.sample(RTTS_MS, len(RTTS_MS)):
                for mode in chance.sample(MODES, len(MODES)):
                    configuration = Configuration(
                        scene=SCENE,
                        movement="look-around",
                        movement_offset_s=block * END_S,
                        network=Network(trace=TRACE, trace_file=Path(TRACE), rtt_ms=rtt),
                        mode=mode,
                        profile=RUNG,
                        duration_s=END_S,
                        width=SIZE[0],
                        height=SIZE[1],
                        seed=seed,
                        capture_every_ms=0,
                        warm_up_s=1,
                    )
                    try:
                        run = Run(mode, rtt, block, await measured(environment, configuration))
                    except (RunFailed, BrokenRecording) as error:
                        typer.echo(f"block {block}, {rtt:g} ms, {mode}: {error}", err=True)
                        continue
                    runs.append(run)
                    told = ", ".join(
                        f"{name} {shown.format(value)}"
                        for (name, shown), value in zip(FIGURES.items(), run.figures, strict=True)
                    )
                    typer.echo(f"block {block}, {rtt:g} ms, {mode}: {told}", err=True)
    return runs


def main(
    blocks: Annotated[int, typer.Option(min=1, help="Six or more have intervals.")] = 6,
    seed: Annotated[int, typer.Option(help="Of the movement, and of the order of runs.")] = 1,
) -> None:
    """Measure, and print a table."""
    os.environ |= {"TIGAS_RENDER_DEVICE": "cpu,cpu", "TIGAS_RENDER_EDGES": "1"}
    with in_a_sentence(StartError, OSError), tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        folder.chmod(0o755)  # the lab's services have a user of their own
        write_ply(folder / f"{SCENE}.ply", scene())
        (folder / TRACE).write_text(TRACE_TEXT)
        began, load = time.monotonic(), psutil.getloadavg()[0]
        runs = asyncio.run(run_all(folder, blocks, seed))
    for line in table(runs):
        typer.echo(line)
    typer.echo(
        f"\n{len(runs)} runs in {time.monotonic() - began:.0f} s at commit {this_commit()}, on {psutil.cpu_count()} "
        f"processors whose load was {load:.1f} before."
    )


async def _both_engines(url: str) -> None:
    """Wait for the one that the run before has killed. Raises RunFailed."""
    async with httpx.AsyncClient(trust_env=False) as http:
        for _ in range(round(START_S / POLL_S)):
            answer = await http.get(f"{url}/metrics")
            if len(re.findall(r"^tigas_render_device_up\{[^}]*\} 1", answer.text, re.MULTILINE)) == 2:
                return
            await asyncio.sleep(POLL_S)
    raise RunFailed(f"The killed engine was not back within {START_S:g} s.")


async def _kill(lab: psutil.Process) -> float:
    """Kill the engine that works most, KILL_S from now on; the time, unix ms."""
    await asyncio.sleep(KILL_S - LOOK_S)
    engines = [each for each in lab.children(recursive=True) if each.name().startswith("engine ")]
    before = {engine: engine.cpu_times().user for engine in engines}
    await asyncio.sleep(LOOK_S)
    max(engines, key=lambda engine: engine.cpu_times().user - before[engine]).kill()
    return time.time() * 1000


def _between(times: Sequence[float], begin_s: float, end_s: float) -> list[float]:
    begin, end = (begin_s + MARGIN_S) * 1000, (end_s - MARGIN_S) * 1000
    return [at for at in times if begin <= at < end]


def _gaps(times: Sequence[float]) -> list[float]:
    return [late - early for early, late in pairwise(times)]


def _ratio(logarithm: Estimate | None) -> str:
    if logarithm is None:
        return ""
    interval = "" if logarithm.interval is None else " [{:.2f}, {:.2f}]".format(*map(math.exp, logarithm.interval))
    return f"{math.exp(logarithm.mean):.2f}{interval}"


if __name__ == "__main__":
    typer.run(main)
