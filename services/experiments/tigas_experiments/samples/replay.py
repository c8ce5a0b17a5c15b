"""Renders one sample again: compares it with the run's frame, and adds ground truth."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError

from tigas_common.files import read_regular
from tigas_common.parsing import sentence
from tigas_common.pose import Intrinsics
from tigas_common.wire.render import RenderRequest
from tigas_experiments.quality.picture import BrokenPicture, compare, decode, opened
from tigas_experiments.records.samples import JPEG, MAX_PICTURE_BYTES, REPLAYED, TRUTH, Rerendered, sample_path
from tigas_experiments.samples.renderer import NotRendered, Renderer
from tigas_experiments.wire.recording import Sample


def request_again(sample: Sample) -> RenderRequest:
    """The run's request, without its deadline."""
    return sample.request.model_copy(update={"deadline_ms": None})


def shown_size(sample: Sample) -> tuple[int, int]:
    """Width and height in pixels, margins of overscan included: of the enhanced picture; any other was enlarged to the
    viewport by the display.
    """
    lens = _lens(sample.request)
    return (sample.width, sample.height) if sample.enhanced else (lens.width, lens.height)


def request_truth(sample: Sample) -> RenderRequest:
    """Request for the same view without loss in its displayed size. Raises NotRendered if the size is impossible."""
    request = sample.request
    lens = _lens(request).resized(*shown_size(sample))
    plain = {
        "profile": None, "format": "png", "deadline_ms": None, "overscan": 0.0, "depth": False
    }  # fmt: skip
    try:
        return RenderRequest.model_validate(request.model_dump() | asdict(lens) | plain)
    except ValidationError as error:
        raise NotRendered(f"There is no such view: {sentence(error)}") from None


def _lens(request: RenderRequest) -> Intrinsics:
    """Intrinsics of the whole requested view, in viewport pixels."""
    margins = (round(side * request.overscan) for side in (request.width, request.height))
    return request.intrinsics.widened(*margins)


async def replay(run: Path, sample: Sample, renderer: Renderer, *, again: bool = False) -> Rerendered:
    """Render a sample and its ground truth, if missing or `again`, and keep the results.

    Raises RendererAway and OSError.
    """
    problems: list[str] = []
    identical = psnr_db = None
    try:
        identical, psnr_db = await _compare(run, sample, await renderer.frame(request_again(sample)))
    except (NotRendered, BrokenPicture) as error:
        problems.append(str(error))
    if again or not await asyncio.to_thread(has_truth, run, sample):
        try:
            truth = await renderer.frame(request_truth(sample))
            await asyncio.to_thread(_keep_truth, run, sample, truth)
        except (NotRendered, BrokenPicture) as error:
            problems.append(str(error))
    return Rerendered(
        seq=sample.seq, identical=identical, problem=" ".join(dict.fromkeys(problems)) or None, psnr_db=psnr_db
    )


def has_truth(run: Path, sample: Sample) -> bool:
    """Whether the ground truth of a sample is there, whole."""
    try:
        check_truth(read_regular(sample_path(run, sample.seq, TRUTH), MAX_PICTURE_BYTES, follow=False), sample)
    except (OSError, BrokenPicture):
        return False
    return True


def check_truth(data: bytes, sample: Sample) -> None:
    """Raises BrokenPicture if it is no whole PNG of a sample's size."""
    with opened(data) as image:
        if image.format != "PNG":
            raise BrokenPicture(f"The ground truth is no PNG, but {image.format}.")
        if image.size != shown_size(sample):
            (width, height), (wanted_width, wanted_height) = image.size, shown_size(sample)
            raise BrokenPicture(f"The ground truth has {width}×{height} pixels, not {wanted_width}×{wanted_height}.")
        image.verify()


async def _compare(run: Path, sample: Sample, again: bytes) -> tuple[bool, float | None]:
    """Whether the frame is identical to the run's and, if not, their PSNR. Keeps a differing frame."""
    kept = sample_path(run, sample.seq, REPLAYED)
    try:
        path = sample_path(run, sample.seq, JPEG)
        came = await asyncio.to_thread(read_regular, path, MAX_PICTURE_BYTES, follow=False)
    except OSError as error:
        raise BrokenPicture(f"The frame received in the run cannot be read: {error.strerror or error}.") from None
    if came == again:
        with _in_the_way(kept):
            kept.unlink(missing_ok=True)
        return True, None
    apart = await asyncio.to_thread(_psnr_db, came, again)
    await asyncio.to_thread(_write_whole, kept, again)
    return False, apart


def _psnr_db(came: bytes, again: bytes) -> float | None:
    """PSNR of two frames; None for different sizes. Raises BrokenPicture."""
    one, other = decode(came), decode(again)
    return compare(one, other).psnr_db if one.shape == other.shape else None


def _keep_truth(run: Path, sample: Sample, truth: bytes) -> None:
    check_truth(truth, sample)
    _write_whole(sample_path(run, sample.seq, TRUTH), truth)


def _write_whole(path: Path, data: bytes) -> None:
    """Write a file atomically; a link of that name is replaced, not followed.

    Raises BrokenPicture if a folder has that name, and OSError.
    """
    part = path.with_name(f".{path.name}.part")
    with _in_the_way(path):
        part.unlink(missing_ok=True)
        with part.open("xb") as file:
            file.write(data)
        part.replace(path)


@contextmanager
def _in_the_way(path: Path) -> Iterator[None]:
    try:
        yield
    except IsADirectoryError:
        raise BrokenPicture(f"A folder is in the way of {path.name}.") from None
