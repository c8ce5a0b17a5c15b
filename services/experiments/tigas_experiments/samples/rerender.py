"""Renders a run's samples again, a few at a time, compares each with the run's frame, and adds ground truth."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from tigas_common.errors import StartError
from tigas_common.files import read_regular
from tigas_common.parsing import describe_error
from tigas_common.pose import Intrinsics
from tigas_common.render_requests import MAX_CONCURRENT, RenderClient, RenderProblem, RenderUnavailable
from tigas_common.wire.render import RenderRequest
from tigas_experiments.lock import LOCK_NAME, hold_lock
from tigas_experiments.quality.picture import BrokenPicture, compare, decode, open_picture
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, StoredRun, experiment_folder
from tigas_experiments.records.samples import (
    JPEG,
    MAX_PICTURE_BYTES,
    REPLAYED,
    TRUTH,
    Rerendered,
    SampledRun,
    append_rerendered,
    read_sampled_run,
    rerender_log,
    sample_path,
)
from tigas_experiments.wire.recording import Sample

Item = TypeVar("Item")
OnProgress = Callable[[int, int], None]
"""Progress callback: number of finished samples of a run, and their total."""


async def rerender(
    run: Path, renderer: RenderClient, on_progress: OnProgress = lambda done, total: None, *, again: bool = False
) -> SampledRun:
    """Render all incomplete samples of a run, or all samples if `again`.

    May be interrupted at any time; the next call continues from there.

    Raises OSError, and RenderUnavailable if the service does not answer.
    """
    before = await asyncio.to_thread(read_sampled_run, run)
    if before.problem is not None or not before.samples:
        return before
    if (run / "samples").is_symlink() or not (run / "samples").is_dir():
        return replace(before, problem=f"{run / 'samples'} is not a folder of images.")
    known: Mapping[int, Rerendered] = {} if again else before.known
    todo = [one for one in before.samples if not await asyncio.to_thread(_is_complete, run, one, known)]
    if not todo:
        return before
    try:
        record = StoredRun(run).record
        if any(one.request.scene != record.configuration.scene for one in before.samples):
            return replace(before, problem="Its samples are of another scene than the run.")
        scene = await renderer.load(record.configuration.scene)
    except (BrokenRecording, RenderProblem) as error:
        return replace(before, problem=str(error))
    if (changed := changed_scene(record, scene.file_sha256)) is not None:
        return replace(before, problem=changed)
    total = len(before.samples)
    await _rerender_samples(run, todo, renderer, lambda done: on_progress(total - len(todo) + done, total), again)
    return await asyncio.to_thread(read_sampled_run, run)


async def _rerender_samples(
    run: Path, todo: Sequence[Sample], renderer: RenderClient, on_progress: Callable[[int], None], again: bool
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

        await run_concurrently(todo, work)


async def run_concurrently(items: Iterable[Item], work: Callable[[Item], Awaitable[None]]) -> None:
    """Process items with MAX_CONCURRENT workers. Raises the first RenderUnavailable or OSError of a worker."""
    left = iter(items)

    async def worker() -> None:
        for item in left:
            await work(item)

    try:
        async with asyncio.TaskGroup() as group:
            for _ in range(MAX_CONCURRENT):
                group.create_task(worker())
    except* (RenderUnavailable, OSError) as errors:
        raise errors.exceptions[0] from None


def changed_scene(record: RunRecord, sha256: str | None) -> str | None:
    """A sentence if the scene's file is known to differ from the run's."""
    if None in (record.scene_sha256, sha256) or record.scene_sha256 == sha256:
        return None
    return (
        f"The file of the scene {record.configuration.scene!r} has changed since the run, so the service cannot "
        "render its ground truth."
    )


def require_sampled_runs(folder: Path) -> list[Path]:
    """Runs with samples in the folder of an experiment or a run. Raises StartError if there are none."""
    found = find_sampled_runs(folder)
    if not found:
        raise StartError(f"{folder} has no samples: only runs with a `sample_stride` do (docs/experiments.md).")
    return found


def find_sampled_runs(folder: Path) -> list[Path]:
    """Like `require_sampled_runs`, but possibly empty. Raises StartError if there are no runs."""
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
def lock_experiment(folder: Path) -> Iterator[None]:
    """Lock an experiment against other writers during the context. Raises StartError and OSError."""
    experiment = experiment_folder(folder)
    busy = f"Another command is using {experiment}; try again later."
    with hold_lock(experiment / LOCK_NAME, busy):
        yield


def _is_complete(run: Path, sample: Sample, known: Mapping[int, Rerendered]) -> bool:
    """Whether nothing remains to be rendered."""
    one = known.get(sample.seq)
    if one is None or one.problem is not None or not has_truth(run, sample):
        return False
    return one.identical is True or sample_path(run, sample.seq, REPLAYED).is_file()


def repeated_request(sample: Sample) -> RenderRequest:
    """The run's request, without its deadline."""
    return sample.request.model_copy(update={"deadline_ms": None})


def displayed_size(sample: Sample) -> tuple[int, int]:
    """Width and height in pixels, with overscan margins: of an enhanced picture as shown, or else enlarged to the
    viewport.
    """
    lens = _lens(sample.request)
    return (sample.width, sample.height) if sample.enhanced else (lens.width, lens.height)


def truth_request(sample: Sample) -> RenderRequest:
    """Request for the same view, lossless and in its displayed size. Raises BrokenPicture if the size is impossible."""
    request = sample.request
    lens = _lens(request).resized(*displayed_size(sample))
    plain = {
        "profile": None, "format": "png", "deadline_ms": None, "overscan": 0.0, "depth": False
    }  # fmt: skip
    try:
        return RenderRequest.model_validate(request.model_dump() | asdict(lens) | plain)
    except ValidationError as error:
        raise BrokenPicture(f"There is no such view: {describe_error(error)}") from None


def _lens(request: RenderRequest) -> Intrinsics:
    """Intrinsics of the whole requested view, in viewport pixels."""
    margins = (round(side * request.overscan) for side in (request.width, request.height))
    return request.intrinsics.with_margins(*margins)


async def replay(run: Path, sample: Sample, renderer: RenderClient, *, again: bool = False) -> Rerendered:
    """Render a sample and its ground truth, if missing or `again`, and store the results.

    Raises RenderUnavailable and OSError.
    """
    problems: list[str] = []
    identical = psnr_db = None
    try:
        identical, psnr_db = await _compare(run, sample, await renderer.frame(repeated_request(sample)))
    except (RenderProblem, BrokenPicture) as error:
        problems.append(str(error))
    if again or not await asyncio.to_thread(has_truth, run, sample):
        try:
            truth = await renderer.frame(truth_request(sample))
            await asyncio.to_thread(_keep_truth, run, sample, truth)
        except (RenderProblem, BrokenPicture) as error:
            problems.append(str(error))
    return Rerendered(
        seq=sample.seq, identical=identical, problem=" ".join(dict.fromkeys(problems)) or None, psnr_db=psnr_db
    )


def has_truth(run: Path, sample: Sample) -> bool:
    """Whether a sample has complete ground truth."""
    try:
        check_truth(read_regular(sample_path(run, sample.seq, TRUTH), MAX_PICTURE_BYTES, follow=False), sample)
    except (OSError, BrokenPicture):
        return False
    return True


def check_truth(data: bytes, sample: Sample) -> None:
    """Raise BrokenPicture unless the data is a complete PNG of a sample's size."""
    with open_picture(data) as image:
        if image.format != "PNG":
            raise BrokenPicture(f"The ground truth is not PNG, but {image.format}.")
        if image.size != displayed_size(sample):
            (width, height), (wanted_width, wanted_height) = image.size, displayed_size(sample)
            raise BrokenPicture(f"The ground truth has {width}×{height} pixels, not {wanted_width}×{wanted_height}.")
        image.verify()


async def _compare(run: Path, sample: Sample, again: bytes) -> tuple[bool, float | None]:
    """Whether the frame is identical to the run's and, if not, their PSNR. Stores a differing frame."""
    kept = sample_path(run, sample.seq, REPLAYED)
    try:
        path = sample_path(run, sample.seq, JPEG)
        original = await asyncio.to_thread(read_regular, path, MAX_PICTURE_BYTES, follow=False)
    except OSError as error:
        raise BrokenPicture(f"The frame received in the run cannot be read: {error.strerror or error}.") from None
    if original == again:
        with _folder_errors(kept):
            kept.unlink(missing_ok=True)
        return True, None
    apart = await asyncio.to_thread(_psnr_db, original, again)
    await asyncio.to_thread(_write_atomically, kept, again)
    return False, apart


def _psnr_db(original: bytes, again: bytes) -> float | None:
    """PSNR of two frames; None if their sizes differ. Raises BrokenPicture."""
    one, other = decode(original), decode(again)
    return compare(one, other).psnr_db if one.shape == other.shape else None


def _keep_truth(run: Path, sample: Sample, truth: bytes) -> None:
    check_truth(truth, sample)
    _write_atomically(sample_path(run, sample.seq, TRUTH), truth)


def _write_atomically(path: Path, data: bytes) -> None:
    """Write a file atomically; a link of that name is replaced, not followed.

    Raises BrokenPicture if a folder has that name, and OSError.
    """
    part = path.with_name(f".{path.name}.part")
    with _folder_errors(path):
        part.unlink(missing_ok=True)
        with part.open("xb") as file:
            file.write(data)
        part.replace(path)


@contextmanager
def _folder_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except IsADirectoryError:
        raise BrokenPicture(f"A folder is in the way of {path.name}.") from None
