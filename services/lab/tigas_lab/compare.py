"""A comparison: the same movement over the same networks, mode after mode, and a report of what was seen."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tigas_lab.browser import find_chromium
from tigas_lab.configuration import Configuration
from tigas_lab.inputs import movement_points
from tigas_lab.machine import this_machine
from tigas_lab.report.page import ReportData, write_report
from tigas_lab.run import Bench, run
from tigas_lab.store import RunRecord
from tigas_lab.targets import Target, lab_target, load_scene, url_target


@dataclass(frozen=True, slots=True)
class Comparison:
    """What to compare, against what, and where to."""

    runs: Sequence[Configuration]
    out: Path
    command: str
    """As it was typed."""
    url: str | None
    """Of running services; without it, the lab is started."""
    scenes: Path | None
    traces: Path | None


@dataclass(frozen=True, slots=True)
class Listener:
    """Who wants to know how it goes."""

    stage: Callable[[str], None]
    """What is going on."""
    finished: Callable[[RunRecord], None]
    """A run has ended."""


def default_out() -> Path:
    """A folder for a comparison that begins now."""
    return Path("results", f"compare-{datetime.now(UTC):%Y%m%d-%H%M%S}")


async def make_runs(comparison: Comparison, listener: Listener, made: list[Path]) -> None:
    """Make all runs; `made` gets each one's folder as it begins, so that it is known whatever happens.

    Raises StartError and OSError.
    """
    find_chromium()
    listener.stage("starts the services")
    async with _target(comparison) as target:
        for number, configuration in enumerate(comparison.runs, 1):
            listener.stage("loads the scene")
            scene = await load_scene(target.url, configuration.scene)
            points = movement_points(configuration, scene)
            folder = comparison.out / "runs" / f"{number:02}_{configuration.slug}"
            made.append(folder)
            bench = Bench(target, scene, this_machine())
            listener.finished(await run(bench, configuration, points, folder, listener.stage))


def report_on(comparison: Comparison, made: Sequence[Path]) -> ReportData:
    """The report of the runs that were made. Raises OSError."""
    scenes = ", ".join(dict.fromkeys(run.scene for run in comparison.runs))
    return write_report(made, comparison.out, f"{scenes}: one JPEG per pose and low-latency DASH", comparison.command)


@asynccontextmanager
async def _target(comparison: Comparison) -> AsyncIterator[Target]:
    if comparison.url is None:
        async with lab_target(comparison.scenes, comparison.traces) as target:
            yield target
    else:
        async with url_target(comparison.url) as target:
            yield target
