"""A comparison: the same movement over the same networks, mode after mode, and a report of what was seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tigas_common.wire.run import Configuration
from tigas_experiments.records.folder import RunRecord
from tigas_experiments.report.page import ReportData, write_report
from tigas_experiments.run.inputs import Inputs
from tigas_experiments.run.laboratory import laboratory
from tigas_experiments.run.measure import run


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
    async with laboratory(comparison.url, comparison.scenes, comparison.traces, Inputs(Path())) as lab:
        listener.stage("starts the services")
        await lab.check(comparison.runs)
        for number, configuration in enumerate(comparison.runs, 1):
            folder = comparison.out / "runs" / f"{number:02}_{configuration.slug}"
            made.append(folder)
            listener.finished(await run(lab, configuration, folder, listener.stage))


def report_on(comparison: Comparison, made: Sequence[Path]) -> ReportData:
    """The report of the runs that were made. Raises OSError."""
    scenes = ", ".join(dict.fromkeys(run.scene for run in comparison.runs))
    return write_report(made, comparison.out, f"{scenes}: one JPEG per pose and low-latency DASH", comparison.command)
