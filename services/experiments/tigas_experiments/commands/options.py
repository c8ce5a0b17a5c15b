"""Options and helpers shared by the commands that make runs."""

from __future__ import annotations

import asyncio
import shlex
import signal
import sys
from typing import TYPE_CHECKING, Annotated

from tigas_common.command import Command, Metavar
from tigas_common.terminal import make_console

if TYPE_CHECKING:  # heavy
    from tigas_experiments.run.experiment import Experiment


class Measure(Command):
    """A command that measures running services, or a lab started by it."""

    url: Annotated[str | None, Metavar("URL")] = None
    """Viewer page of running services to measure; without it, the lab is started."""


def make_runs(made: Experiment, url: str | None, *, allow_changes: bool = False) -> None:
    """Make an experiment's missing runs, with progress. Raises StartError and OSError."""
    from tigas_experiments.report.controllers import run_names
    from tigas_experiments.run.progress import progress
    from tigas_experiments.run.runner import make_missing_runs

    missing = made.missing()
    if missing:
        with progress(made, missing, run_names(made.runs), make_console(stderr=True)) as callbacks:
            asyncio.run(make_missing_runs(made, missing, url, callbacks, allow_changes=allow_changes))


def command_as_typed() -> str:
    return shlex.join(["tigas", *sys.argv[1:]])


def end_as_ctrl_c() -> None:
    """Handle SIGTERM like Ctrl+C, and restore Ctrl+C in background jobs of scripts, so that every end cleans up."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
