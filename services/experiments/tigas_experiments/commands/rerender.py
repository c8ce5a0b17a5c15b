"""The command `tigas experiment rerender`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tigas_common.command import POSITIONAL, Command, Metavar
from tigas_common.processes import handle_sigterm_as_ctrl_c
from tigas_common.terminal import make_console, progress_bar

if TYPE_CHECKING:  # heavy
    from tigas_experiments.records.samples import SampledRun


class SamplesCommand(Command):
    """A command that processes the samples of runs."""

    folder: Annotated[Path, POSITIONAL, Metavar("DIR")]
    """Folder of a run or an experiment."""
    again: bool = False
    """Also repeat finished work."""


class RenderCommand(Command):
    """A command that needs a render service."""

    render: Annotated[str | None, Metavar("URL")] = None
    """URL of the render service; by default, one with the experiment's ladder is started."""


class Rerender(SamplesCommand, RenderCommand):
    """Render a run's samples again: compare each frame with the received one, and keep its ground truth.

    If interrupted, run the command again to continue.
    """

    def run(self) -> None:
        from rich.table import Table

        handle_sigterm_as_ctrl_c()
        console = make_console()
        try:
            with render_url(self.folder, self.render) as url:
                outcomes = rerender_all(self.folder, url, again=self.again)
        except KeyboardInterrupt:
            console.print("Interrupted. Run the same command to continue.")
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


@contextmanager
def render_url(folder: Path, given: str | None) -> Iterator[str]:
    """The URL of the given render service, or of one that runs during the context. Raises StartError."""
    from tigas_common.render_requests import run_render_service
    from tigas_experiments.records.files import BrokenRecording
    from tigas_experiments.records.folder import experiment_folder, read_experiment

    if given is not None:
        yield given
        return
    try:
        ladder = read_experiment(experiment_folder(folder)).plan.get("ladder")
    except BrokenRecording:  # a run outside an experiment
        ladder = None
    with run_render_service(ladder="paper" if ladder == "paper" else "scene") as url:
        yield url


def rerender_all(folder: Path, render: str, *, again: bool = False) -> list[SampledRun]:
    """Render all samples of a run or an experiment, with a progress bar. Raises StartError and OSError."""
    from tigas_common.render_requests import RenderClient
    from tigas_experiments.samples.rerender import lock_experiment, require_sampled_runs, rerender

    runs = require_sampled_runs(folder)

    async def all_of_them(show: Callable[[float, str], None]) -> list[SampledRun]:
        outcomes = []
        async with RenderClient.connect(render) as renderer:
            for number, run in enumerate(runs):

                def on_progress(done: int, total: int, number: int = number) -> None:
                    show((number + done / total) / len(runs), f"run {number + 1} of {len(runs)}")

                outcomes.append(await rerender(run, renderer, on_progress, again=again))
        return outcomes

    with lock_experiment(folder), progress_bar() as show:
        return asyncio.run(all_of_them(show))
