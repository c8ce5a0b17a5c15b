"""The commands `tigas quality …`: scores of sampled pictures, and the weights that metrics need."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.box import SIMPLE_HEAD
from rich.table import Table

from tigas_common.cli import report_errors
from tigas_common.command import POSITIONAL, Command, Group, Metavar
from tigas_common.errors import StartError
from tigas_common.processes import handle_sigterm_as_ctrl_c
from tigas_common.terminal import make_console, printable, progress_bar
from tigas_experiments.commands.rerender import RenderCommand, SamplesCommand, render_url, rerender_all

if TYPE_CHECKING:  # heavy
    from tigas_experiments.quality.metrics import PictureMetric
    from tigas_experiments.records.folder import RunRecord
    from tigas_experiments.report.picture_scores import Row
    from tigas_experiments.scoring import Scoring


class Score(SamplesCommand):
    """Compare the samples of a run with ground truth, both as received and as enhanced."""

    metrics: str = "psnr,ssim,vmaf,vif,lpips,dists"
    """Metrics, separated by commas."""
    render: Annotated[str | None, Metavar("URL")] = None
    """Render service that renders missing ground truth first."""

    def run(self) -> None:
        handle_sigterm_as_ctrl_c()
        console = make_console(stderr=True)
        asked = _parse_metrics(self.metrics)
        try:
            for problem in () if self.render is None else _render_truth(self.folder, self.render):
                console.print(problem, style="yellow", soft_wrap=True)
            rows, sentences = _score(self.folder, asked, again=self.again)
        except KeyboardInterrupt:
            console.print("Interrupted. Run the same command to continue.")
            raise SystemExit(130) from None
        for sentence in sentences:
            console.print(sentence, style="yellow", soft_wrap=True)
        if not rows:
            raise SystemExit(1)
        make_console().print(_table(rows, asked))


class Ladder(RenderCommand):
    """Show a view of an experiment at each rung of the ladder, with its size: ladder.jpg and ladder.csv."""

    folder: Annotated[Path, POSITIONAL, Metavar("DIR")]
    """Folder of the experiment."""

    def run(self) -> None:
        from tigas_common.render_requests import RenderClient
        from tigas_experiments.quality.picture import BrokenPicture
        from tigas_experiments.report.ladder import Step, sample_views, write_ladder
        from tigas_experiments.report.ladder import render_ladder as steps

        async def asked(url: str) -> list[Step]:
            async with RenderClient.connect(url) as renderer:
                return await steps(renderer, *views)

        views = sample_views(self.folder)
        with report_errors(BrokenPicture), render_url(self.folder, self.render) as url:
            for path in write_ladder(asyncio.run(asked(url)), self.folder):
                print(printable(str(path)))


class Fetch(Command):
    """Fetch the weights of LPIPS and DISTS into the user's cache, and the pictures that tests compare them on."""

    def run(self) -> None:
        from tigas_experiments.quality.weights import SOURCES, Source, fetch

        def shown(source: Source) -> Callable[[int, int | None], None]:
            return lambda done, _: show(done / source.size, f"{source.name}, {source.size / 1e6:.1f} MB")

        with progress_bar() as show:
            for source in SOURCES:
                print(fetch(source, shown(source)))


quality = Group(
    "Compare sampled pictures with ground truth by six metrics (docs/experiments.md): tigas quality RUN.",
    {"score": Score, "ladder": Ladder, "fetch": Fetch},
    default="score",
)


def _parse_metrics(names: str) -> list[PictureMetric]:
    """The metrics with these names. Raises StartError."""
    from tigas_experiments.quality.metrics import PICTURE_METRICS

    known = {metric.name: metric for metric in PICTURE_METRICS}
    asked = [name.strip().lower() for name in names.split(",") if name.strip()]
    if unknown := [name for name in asked if name not in known]:
        raise StartError(f"{unknown[0]!r} is not a metric; choose from {', '.join(known)}.")
    if not asked:
        raise StartError(f"--metrics is empty; choose from {', '.join(known)}.")
    return [metric for name, metric in known.items() if name in asked]


def _score(folder: Path, asked: list[PictureMetric], *, again: bool) -> tuple[list[Row], list[str]]:
    """The scores, and warnings about them. Raises StartError and OSError."""
    import torch

    from tigas_experiments.lock import LOCK_NAME, hold_lock
    from tigas_experiments.quality.metrics import Meters
    from tigas_experiments.records.files import BrokenRecording
    from tigas_experiments.report.picture_scores import score_rows
    from tigas_experiments.report.run_table import Condition
    from tigas_experiments.scoring import Scoring

    runs, lock = _runs(folder)
    meters = Meters.create([metric.name for metric in asked], "cuda" if torch.cuda.is_available() else "cpu")
    sentences = [*meters.unavailable]
    if not meters.single and not meters.video:
        raise StartError(" ".join(sentences))
    scorings: dict[Path, Scoring] = {}
    scored = []
    finished, current = 0, ""
    busy = f"Runs in {lock} are being made or scored; try again later."
    with hold_lock(lock / LOCK_NAME, busy), progress_bar() as show:

        def on_progress(steps: int) -> None:
            nonlocal finished
            finished += steps
            show(finished / total, current)

        for run in runs:
            try:
                scorings[run] = Scoring(run, meters, on_progress, again=again)
            except BrokenRecording as error:
                sentences.append(f"{run.name}: {error}")
        total = sum(scoring.steps for scoring in scorings.values())
        if not total:
            raise StartError(
                " ".join(sentences) or f"{folder} has no samples or captures with ground truth (docs/experiments.md)."
            )
        left_out = 0
        for run, scoring in scorings.items():
            current = run.name
            scores, record = scoring.score(), _record(run)
            sentences += _warnings(run, scoring)
            if len(runs) > 1 and record is not None and record.status != "complete":
                left_out += 1
            else:
                scored.append((None if record is None else Condition.from_record(record), scores))
    if left_out:
        count = "One run is" if left_out == 1 else f"{left_out} runs are"
        sentences.append(f"{count} not complete, and not in the table.")
    return score_rows(scored), sentences


def _render_truth(folder: Path, render: str) -> Iterator[str]:
    """Render missing ground truth, and yield problems. Raises StartError and OSError."""
    from tigas_common.render_requests import RenderClient
    from tigas_experiments.samples.capture_truth import render_truth
    from tigas_experiments.samples.rerender import find_sampled_runs, lock_experiment

    runs, _ = _runs(folder)
    if find_sampled_runs(folder):
        for sampled in rerender_all(folder, render):
            yield from (f"{sampled.folder}: {problem}" for problem in sampled.problems)

    async def all_of_them(show: Callable[[float, str], None]) -> list[str]:
        problems = []
        async with RenderClient.connect(render) as renderer:
            for run in runs:

                def on_progress(done: int, total: int, run: Path = run) -> None:
                    show(done / total, run.name)

                if (run / "captures.ndjson").exists() and (problem := await render_truth(run, renderer, on_progress)):
                    problems.append(f"{run.name}: {problem}")
        return problems

    with lock_experiment(folder), progress_bar() as show:
        yield from asyncio.run(all_of_them(show))


def _record(run: Path) -> RunRecord | None:
    """The record of a run; None for any other folder."""
    from tigas_experiments.records.files import BrokenRecording
    from tigas_experiments.records.folder import StoredRun

    try:
        return StoredRun(run).record
    except BrokenRecording:
        return None


def _warnings(run: Path, scoring: Scoring) -> Iterator[str]:
    from tigas_experiments.records.samples import read_sampled_run

    for name, why in scoring.problems.items():
        yield f"{run.name}, {name}: {why}"
    sampled = read_sampled_run(run)
    if different := sampled.different:
        yield (
            f"{run.name}: on rendering again, {different} of {len(sampled.samples)} samples differed, so their "
            "ground truth may not match."
        )


def _runs(folder: Path) -> tuple[list[Path], Path]:
    """Folders with samples, and the folder to lock. Raises StartError."""
    from tigas_experiments.records.folder import experiment_folder
    from tigas_experiments.report.run_table import run_folders

    if (folder / "samples").is_dir() or (folder / "run.json").exists():
        return [folder], experiment_folder(folder)
    return run_folders(folder), folder


def _table(rows: list[Row], asked: list[PictureMetric]) -> Table:
    table = Table(
        title="Mean ± standard deviation over pictures", title_justify="left", box=SIMPLE_HEAD, pad_edge=False
    )
    table.add_column("network, controller, picture", overflow="fold")
    table.add_column("pictures", justify="right")
    for metric in asked:
        table.add_column(metric.title + (f", {metric.unit}" if metric.unit else ""), justify="right", no_wrap=True)
    for row in rows:
        network, rtt, controller = row.condition or ("", None, None)
        label = (
            network,
            f"{rtt:g} ms" if rtt is not None else "",
            controller.title if controller else "",
            row.kind,
            row.model or "",
        )
        means = {metric: row.mean(metric) for metric in asked}
        table.add_row(
            ", ".join(filter(None, label)),
            str(max((mean.pictures for mean in means.values() if mean is not None), default=0)),
            *(
                "–" if mean is None else mean.text(metric, signed=row.kind == "difference").replace(" ±", "\n±")
                for metric, mean in means.items()
            ),
        )
    return table
