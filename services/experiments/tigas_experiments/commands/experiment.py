"""The commands `tigas experiment …`."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console
from tigas_experiments.commands.materialise import materialise
from tigas_experiments.commands.options import Scenes, Traces, Url, command_as_typed

experiment = typer.Typer(help="Run a matrix of runs described in one file (docs/experiments.md).", no_args_is_help=True)
experiment.command("materialise")(materialise)

File = Annotated[Path, typer.Argument(help="The experiment's TOML file.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the runs.", show_default="results/NAME")]


@experiment.command("plan")
def plan(file: File, out: Out = None) -> None:
    """List an experiment's runs, which are complete, and how long the missing ones take."""
    from tigas_experiments.run.plan import lasting
    from tigas_experiments.run.runner import Experiment

    with in_a_sentence(StartError, OSError):
        planned = Experiment.read(file, out, command_as_typed())
        missing = planned.missing()
        todo = {run.slug for run in missing}
        for run in planned.runs:
            typer.echo(f"{'missing ' if run.slug in todo else 'complete'}  {run.slug}")
        typer.echo(f"{len(planned.runs)} runs, {len(missing)} missing, which take about {lasting(missing)} (h:mm:ss).")


@experiment.command("import")
def import_(
    file: Annotated[Path, typer.Argument(help="JSON file saved by the page.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the runs.", show_default="results/FILE")] = None,
) -> None:
    """Import an experiment that the page saved as a file, and write its report."""
    from tigas_experiments.report.cli import report
    from tigas_experiments.store.saved import import_saved

    folder = out or Path("results", file.stem)
    with in_a_sentence(StartError, OSError):
        import_saved(file, folder)
        report(folder)


@experiment.command("run")
def run(
    file: File,
    out: Out = None,
    url: Url = None,
    scenes: Scenes = None,
    traces: Traces = None,
    allow_changes: Annotated[
        bool, typer.Option("--allow-changes", help="Resume even if the commit, browser, ladder or a scene has changed.")
    ] = False,
) -> None:
    """Make an experiment's missing runs. Start it again to resume after an interruption."""
    from tigas_experiments.report.cli import report
    from tigas_experiments.run.plan import lasting
    from tigas_experiments.run.progress import progress
    from tigas_experiments.run.runner import Experiment, make_missing_runs, reserved
    from tigas_experiments.run.signals import end_as_ctrl_c

    def say(text: str) -> None:
        console.print(text, soft_wrap=True)

    end_as_ctrl_c()
    console = make_console(stderr=True)
    again = command_as_typed()
    with in_a_sentence(StartError, OSError):
        made = Experiment.read(file, out, again)
        with reserved(made):
            missing = made.missing()
            if missing:
                say(f"{len(missing)} of {len(made.runs)} runs, about {lasting(missing)} (h:mm:ss), into {made.out}")
                try:
                    with progress(made.runs, len(missing), console) as listener:
                        asyncio.run(
                            make_missing_runs(made, missing, url, scenes, traces, listener, allow_changes=allow_changes)
                        )
                except KeyboardInterrupt:
                    say(f"Interrupted. To resume: {again}")
                    raise typer.Exit(130) from None
            incomplete = made.missing()
        if incomplete:
            say(f"{len(incomplete)} of {len(made.runs)} runs are incomplete. To repeat them: {again}")
        else:
            say(f"All {len(made.runs)} runs are complete.")
        report(made.out)
    if incomplete:
        raise typer.Exit(1)
