"""Renders all samples of a run again: only missing ones, a few concurrently."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from tigas_common.errors import StartError
from tigas_experiments.lock import EXPERIMENT, exclusive
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, StoredRun
from tigas_experiments.records.samples import (
    REPLAYED,
    Rerendered,
    SampledRun,
    append_rerendered,
    rerender_log,
    sample_path,
    sampled_run,
)
from tigas_experiments.samples.renderer import NotRendered, Renderer, concurrently
from tigas_experiments.samples.replay import has_truth, replay
from tigas_experiments.wire.recording import Sample

OnProgress = Callable[[int, int], None]
"""Progress callback: number of finished samples of a run, and their total."""


async def rerender(
    run: Path, renderer: Renderer, on_progress: OnProgress = lambda done, total: None, *, again: bool = False
) -> SampledRun:
    """Ask for all samples of a run of which something is missing, or for all `again`.

    It may be ended at any time, and goes on from there when it is called the next time.

    Raises OSError, and RendererAway if the service does not answer.
    """
    before = await asyncio.to_thread(sampled_run, run)
    if before.problem is not None or not before.samples:
        return before
    if (run / "samples").is_symlink() or not (run / "samples").is_dir():
        return replace(before, problem=f"{run / 'samples'} is no folder of pictures.")
    known: Mapping[int, Rerendered] = {} if again else before.known
    todo = [one for one in before.samples if not await asyncio.to_thread(_is_complete, run, one, known)]
    if not todo:
        return before
    try:
        record = StoredRun(run).record
        if any(one.request.scene != record.configuration.scene for one in before.samples):
            return replace(before, problem="Its samples are of another scene than the run.")
        scene = await renderer.load(record.configuration.scene)
    except (BrokenRecording, NotRendered) as error:
        return replace(before, problem=str(error))
    if (changed := changed_scene(record, scene.file_sha256)) is not None:
        return replace(before, problem=changed)
    total = len(before.samples)
    await _ask_for(run, todo, renderer, lambda done: on_progress(total - len(todo) + done, total), again)
    return await asyncio.to_thread(sampled_run, run)


async def _ask_for(
    run: Path, todo: Sequence[Sample], renderer: Renderer, on_progress: Callable[[int], None], again: bool
) -> None:
    """Render a few samples concurrently, and log each result immediately."""
    done = 0
    on_progress(done)
    with rerender_log(run) as log:

        async def work(sample: Sample) -> None:
            nonlocal done
            append_rerendered(log, await replay(run, sample, renderer, again=again))
            done += 1
            on_progress(done)

        await concurrently(todo, work)


def changed_scene(record: RunRecord, sha256: str | None) -> str | None:
    """A sentence if the scene's file is another one than in the run, as far as that is known."""
    if None in (record.scene_sha256, sha256) or record.scene_sha256 == sha256:
        return None
    return (
        f"The file of the scene {record.configuration.scene!r} has changed since the run: what the service would "
        "render now is no ground truth of it."
    )


def sampled_runs(folder: Path) -> list[Path]:
    """Runs with samples in an experiment's or a run's folder. Raises StartError without any."""
    found = with_samples(folder)
    if not found:
        raise StartError(f"{folder} has no samples: only runs with a `sample_stride` have (docs/experiments.md).")
    return found


def with_samples(folder: Path) -> list[Path]:
    """The same; perhaps none. Raises StartError if there are no runs."""
    if (folder / "run.json").is_file():
        runs = [folder]
    else:
        try:
            runs = sorted(path for path in (folder / "runs").iterdir() if _is_run(path))
        except OSError as error:
            raise StartError(
                f"{folder} is neither a run nor an experiment: {error.filename} cannot be read ({error.strerror})."
            ) from None
    return [run for run in runs if (run / "samples.ndjson").exists()]


def _is_run(path: Path) -> bool:
    return not path.name.startswith(".") and not path.is_symlink() and (path / "run.json").is_file()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock an experiment against other writers during the context. Raises StartError and OSError."""
    experiment = folder.parent.parent if folder.parent.name == "runs" else folder
    busy = f"Something else is at work on {experiment}, such as an experiment that makes its runs; try again after it."
    with exclusive(experiment / EXPERIMENT, busy):
        yield


def _is_complete(run: Path, sample: Sample, known: Mapping[int, Rerendered]) -> bool:
    """Whether there is nothing left to ask for."""
    one = known.get(sample.seq)
    if one is None or one.problem is not None or not has_truth(run, sample):
        return False
    return one.identical is True or sample_path(run, sample.seq, REPLAYED).is_file()
