"""The commands `tigas experiment …`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tigas_common.command import POSITIONAL, Command, Group
from tigas_common.terminal import make_console
from tigas_experiments.commands.options import Measure, command_as_typed, end_as_ctrl_c, make_runs
from tigas_experiments.commands.rerender import Rerender


class _ExperimentCommand(Command):
    """A command about an experiment's file."""

    file: Annotated[Path, POSITIONAL]
    """Experiment's file, TOML or JSON."""
    out: Path | None = None
    """Folder for the runs; named after the experiment, in results, unless given."""


class Plan(_ExperimentCommand):
    """List an experiment's runs, which are complete, and how long the missing ones take."""

    def run(self) -> None:
        from tigas_experiments.run.experiment import Experiment
        from tigas_experiments.run.plan import lasting

        planned = Experiment.read(self.file, self.out, command_as_typed())
        missing = planned.missing()
        todo = {run.slug for run in missing}
        for run in planned.runs:
            print(f"{'missing ' if run.slug in todo else 'complete'}  {run.slug}")
        print(f"{len(planned.runs)} runs, {len(missing)} missing, which take about {lasting(missing)}.")


class Run(_ExperimentCommand, Measure):
    """Make an experiment's missing runs. Start it again to resume after an interruption."""

    allow_changes: bool = False
    """Resume even if the commit, browser, ladder or a scene has changed."""

    def run(self) -> None:
        from tigas_experiments.report.cli import Report
        from tigas_experiments.run.experiment import Experiment, reserved

        def say(text: str) -> None:
            console.print(text, soft_wrap=True)

        end_as_ctrl_c()
        console = make_console(stderr=True)
        again = command_as_typed()
        made = Experiment.read(self.file, self.out, again)
        with reserved(made):
            try:
                make_runs(made, self.url, allow_changes=self.allow_changes)
            except KeyboardInterrupt:
                say(f"Interrupted. To resume: {again}")
                raise SystemExit(130) from None
            incomplete = made.missing()
        if incomplete:
            say(f"{len(incomplete)} of {len(made.runs)} runs are incomplete. To repeat them: {again}")
        else:
            say(f"All {len(made.runs)} runs are complete.")
        Report(folder=made.out).run()
        if incomplete:
            raise SystemExit(1)


experiment = Group(
    "Run a matrix of runs described in one file (docs/experiments.md).",
    {"plan": Plan, "run": Run, "rerender": Rerender},
)
