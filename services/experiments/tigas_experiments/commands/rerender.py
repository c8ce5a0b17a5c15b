"""The command `tigas experiment rerender`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tigas_common.command import POSITIONAL, Command, Metavar
from tigas_common.terminal import make_console, progress_bar
from tigas_common.topology import PAGE
from tigas_experiments.commands.options import end_as_ctrl_c

if TYPE_CHECKING:  # heavy
    from tigas_experiments.records.samples import SampledRun

RENDER_URL = f"http://{PAGE.loopback}"


class SamplesCommand(Command):
    """A command about the samples of runs."""

    folder: Annotated[Path, POSITIONAL, Metavar("DIR")]
    """Folder of a run or of an experiment."""
    again: bool = False
    """Repeat finished work as well."""


class RenderCommand(Command):
    """A command that needs a render service."""

    render: Annotated[str, Metavar("URL")] = RENDER_URL
    """Render service."""


class Rerender(SamplesCommand, RenderCommand):
    """Render a run's samples again: compare each frame with the one received, and keep its ground truth.

    An interrupted command continues when it is called again.
    """

    def run(self) -> None:
        from rich.table import Table

        end_as_ctrl_c()
        console = make_console()
        try:
            outcomes = rerender_all(self.folder, self.render, again=self.again)
        except KeyboardInterrupt:
            console.print("Interrupted. The same command goes on.")
            raise SystemExit(130) from None
        table = Table()
        table.add_column("Run", overflow="fold")
        for title in ("Samples", "Identical", "Different", "Incomplete"):
            table.add_column(title, justify="right")
        for one in outcomes:
            counts = (len(one.samples), one.identical, one.different, one.missing)
            table.add_row(one.folder, *map(str, counts), style="yellow" if one.different or one.problems else None)
        console.print(table)
        doubts = [f"{one.folder}: {problem}" for one in outcomes for problem in one.problems]
        if any(one.different for one in outcomes):
            doubts.append(
                "The render service answers differently now: ground truth may be of another renderer than the frames."
            )
        for doubt in doubts:
            console.print(doubt, style="yellow", soft_wrap=True)
        if any(one.problems for one in outcomes):
            raise SystemExit(1)


def rerender_all(folder: Path, render: str, *, again: bool = False) -> list[SampledRun]:
    """Render all samples of a run or an experiment, with a progress bar. Raises StartError and OSError."""
    from tigas_common.render_requests import RenderClient
    from tigas_experiments.samples.rerender import locked, rerender, sampled_runs

    runs = sampled_runs(folder)

    async def all_of_them(show: Callable[[float, str], None]) -> list[SampledRun]:
        outcomes = []
        async with RenderClient.at(render) as renderer:
            for number, run in enumerate(runs):

                def on_progress(done: int, total: int, number: int = number) -> None:
                    show((number + done / total) / len(runs), f"run {number + 1} of {len(runs)}")

                outcomes.append(await rerender(run, renderer, on_progress, again=again))
        return outcomes

    with locked(folder), progress_bar() as show:
        return asyncio.run(all_of_them(show))
