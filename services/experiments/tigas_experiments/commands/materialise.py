"""The command `tigas experiment materialise`."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console
from tigas_common.topology import PAGE

if TYPE_CHECKING:  # heavy
    from tigas_experiments.records.materialised import SampledRun

Render = Annotated[str, typer.Option(help="The render service's URL.")]
RENDER_URL = f"http://{PAGE.loopback}"


def materialise(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run's folder, or an experiment's.")],
    render: Render = RENDER_URL,
    again: Annotated[bool, typer.Option("--again", help="Ask for what is there, too.")] = False,
) -> None:
    """Render a run's samples again: is each frame the one that came, and what should it have looked like?

    After an interruption the same command goes on: what is there already is not asked for.
    """
    from rich.table import Table

    from tigas_experiments.run.signals import end_as_ctrl_c

    end_as_ctrl_c()
    console = make_console()
    with in_a_sentence(StartError, OSError):
        try:
            outcomes = materialised(folder, render, again=again)
        except KeyboardInterrupt:
            console.print("Interrupted. The same command goes on.")
            raise typer.Exit(130) from None
    table = Table()
    table.add_column("Run", overflow="fold")
    for title in ("Samples", "Identical", "Different", "Incomplete"):
        table.add_column(title, justify="right")
    for one in outcomes:
        counts = (len(one.samples), one.identical, one.different, one.missing)
        table.add_row(one.folder, *map(str, counts), style="yellow" if one.different or one.problems else None)
    console.print(table)
    for one in outcomes:
        for problem in one.problems:
            console.print(f"{one.folder}: {problem}", style="yellow", soft_wrap=True)
    if any(one.different for one in outcomes):
        console.print(
            "The render service answers differently now: ground truth may be of another renderer than the frames.",
            style="yellow",
            soft_wrap=True,
        )
    if any(one.problems for one in outcomes):
        raise typer.Exit(1)


def materialised(folder: Path, render: str, *, again: bool = False) -> list[SampledRun]:
    """Materialise all samples of a run or an experiment, with a progress bar. Raises StartError and OSError."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from tigas_experiments.samples.materialise import alone, materialise, sampled_runs
    from tigas_experiments.samples.renderer import Renderer, RendererAway

    runs = sampled_runs(folder)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())

    async def all_of_them(bar: Progress) -> list[SampledRun]:
        outcomes = []
        async with Renderer.at(render) as renderer:
            for number, run in enumerate(runs, 1):
                task = bar.add_task(f"run {number} of {len(runs)}", total=None)
                told = lambda done, total, task=task: bar.update(task, completed=done, total=total)  # noqa: E731
                outcomes.append(await materialise(run, renderer, told, again=again))
                bar.remove_task(task)
        return outcomes

    with alone(folder), Progress(*columns, console=make_console(stderr=True), transient=True) as bar:
        try:
            return asyncio.run(all_of_them(bar))
        except RendererAway as error:
            raise StartError(str(error)) from None
