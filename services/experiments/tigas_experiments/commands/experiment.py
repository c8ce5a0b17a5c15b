"""The commands `tigas experiment …`."""

from __future__ import annotations

import asyncio
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tigas_common.command import POSITIONAL, Command, Group, Metavar
from tigas_common.errors import StartError
from tigas_common.files import change_owner_to_caller
from tigas_common.processes import handle_sigterm_as_ctrl_c
from tigas_common.terminal import make_console
from tigas_experiments.commands.rerender import Rerender

if TYPE_CHECKING:  # heavy
    from tigas_experiments.run.experiment import Experiment

Labs = Annotated[int, Field(ge=1, le=64)]


class _ExperimentCommand(Command):
    """A command that takes an experiment's file."""

    file: Annotated[Path, POSITIONAL]
    """Experiment file, TOML or JSON."""
    out: Path | None = None
    """Folder for the runs; by default `results/` and the experiment's name."""


class Plan(_ExperimentCommand):
    """List an experiment's runs, which of them are complete, and how long the missing ones take."""

    def run(self) -> None:
        from tigas_experiments.run.experiment import Experiment
        from tigas_experiments.run.plan import format_duration

        planned = Experiment.read(self.file, self.out, command_as_typed())
        missing = planned.missing()
        todo = {run.slug for run in missing}
        for run in planned.runs:
            print(f"{'missing ' if run.slug in todo else 'complete'}  {run.slug}")
        print(f"{len(planned.runs)} runs, {len(missing)} missing, which will take about {format_duration(missing)}.")


class Run(_ExperimentCommand):
    """Make an experiment's missing runs. Run it again to resume after an interruption."""

    url: Annotated[str | None, Metavar("URL")] = None
    """URL of the viewer page of running services to measure; by default, a lab is started."""
    labs: Labs = 1
    """Number of labs among which to divide the runs; each needs at least two processors."""
    allow_changes: bool = False
    """Resume even if the commit, browser, ladder or a scene has changed."""

    def run(self) -> None:
        from tigas_experiments.run.experiment import Experiment

        handle_sigterm_as_ctrl_c()
        if self.url is not None and self.labs > 1:
            raise StartError("--url measures running services, and --labs starts several of them: choose one.")
        made = Experiment.read(self.file, self.out, command_as_typed())
        run_experiment(made, self.url, labs=self.labs, allow_changes=self.allow_changes)


def command_as_typed() -> str:
    return shlex.join(["tigas", *sys.argv[1:]])


def run_experiment(made: Experiment, url: str | None = None, *, labs: int, allow_changes: bool) -> None:
    """Make an experiment's missing runs and its report. Raises StartError, OSError, and SystemExit if runs fail."""
    try:
        _perform(made, url, labs, allow_changes)
    finally:
        change_owner_to_caller(made.out)


def _perform(made: Experiment, url: str | None, labs: int, allow_changes: bool) -> None:
    from tigas_experiments.report.cli import Report
    from tigas_experiments.report.controllers import run_names
    from tigas_experiments.run.experiment import reserve_folder
    from tigas_experiments.run.labs import make_runs_in_labs
    from tigas_experiments.run.runner import make_missing_runs, progress

    def say(text: str) -> None:
        console.print(text, soft_wrap=True)

    console = make_console(stderr=True)
    with reserve_folder(made):
        try:
            if missing := made.missing():
                with progress(made, missing, run_names(made.runs), console) as callbacks:
                    if labs > 1:
                        making = make_runs_in_labs(made, missing, labs, callbacks, allow_changes=allow_changes)
                    else:
                        making = make_missing_runs(made, missing, url, callbacks, allow_changes=allow_changes)
                    asyncio.run(making)
        except KeyboardInterrupt:
            say(f"Interrupted. To resume: {made.command}")
            raise SystemExit(130) from None
        incomplete = made.missing()
    if incomplete:
        say(f"{len(incomplete)} of {len(made.runs)} runs are incomplete. To repeat them: {made.command}")
    else:
        say(f"All {len(made.runs)} runs are complete.")
    Report(folder=made.out).run()
    if incomplete:
        raise SystemExit(1)


experiment = Group(
    "Run a matrix of runs described in one file (docs/experiments.md).",
    {"plan": Plan, "run": Run, "rerender": Rerender},
)
