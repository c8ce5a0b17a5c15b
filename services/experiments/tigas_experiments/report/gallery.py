"""Pictures on the page: samples with their ground truth and differences, and a snapshot of each run."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.files import read_regular
from tigas_experiments.quality.metrics import PICTURE_METRICS
from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, upscale_bicubic, upscale_bilinear
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import read_snapshot
from tigas_experiments.records.samples import JPEG, MAX_PICTURE_BYTES, TRUTH, enhanced_path, sample_path
from tigas_experiments.records.scores import Kind
from tigas_experiments.report.run_table import Run
from tigas_experiments.wire.recording import Sample

MAX_SAMPLES = 6
"""Number of samples in a report, from as many runs as possible."""
MAX_SAMPLES_PER_RUN = 3
SAMPLE_WIDTH, SNAPSHOT_WIDTH = 960, 640
AMPLIFICATION = 4
"""Amplification of shown differences."""


class ShownPicture(NamedTuple):
    """A picture as a data: URL."""

    name: str
    url: str
    scores: str
    """Formatted scores against ground truth, if computed."""


class GallerySample(NamedTuple):
    """One sample, with pictures at the size of its ground truth."""

    title: str
    """Run and sequence number."""
    about: str
    remark: str | None
    """Warning about its ground truth."""
    pictures: list[ShownPicture]
    width: int
    height: int


class Snapshot(NamedTuple):
    """The screen and the viewer's correct view at one moment of a run, as data: URLs."""

    title: str
    at_s: float
    shown: str
    view: str


def snapshots(runs: Sequence[tuple[str, Run]]) -> list[Snapshot]:
    """Snapshots of the complete runs (by title) that have a valid one."""
    found: list[Snapshot] = []
    for title, run in runs:
        with suppress(BrokenRecording, BrokenPicture):
            if run.problem is None and (stored := read_snapshot(run.folder)) is not None:
                at, shown, view = stored[0], decode(stored[1]), decode(stored[2])
                height, width = view.shape[:2]
                urls = (_data_url(each, SNAPSHOT_WIDTH) for each in (upscale_bilinear(shown, width, height), view))
                found.append(Snapshot(title, at / 1000, *urls))
    return found


def gallery(runs: Sequence[Run]) -> list[GallerySample]:
    """Samples of complete runs that are valid and have ground truth."""
    rendered = [run for run in runs if run.sampled.samples and run.sampled.known]
    most = min(MAX_SAMPLES, len(rendered))
    chosen = [rendered[number * len(rendered) // most] for number in range(most)]  # spread over all runs
    in_turns = chain.from_iterable(zip_longest(*(islice(_run_samples(run), MAX_SAMPLES_PER_RUN) for run in chosen)))
    return list(islice((one for one in in_turns if one is not None), MAX_SAMPLES))


def _run_samples(run: Run) -> Iterator[GallerySample]:
    """Samples from the beginning, middle and end of a run, then the others; made lazily."""
    known = run.sampled.known
    samples = sorted((one for one in run.sampled.samples if one.seq in known), key=lambda sample: sample.at)
    first = [len(samples) * share // 6 for share in (1, 3, 5)] if len(samples) >= MAX_SAMPLES_PER_RUN else []
    for index in dict.fromkeys((*first, *range(len(samples)))):
        with suppress(OSError, BrokenPicture):
            yield _sample(run, samples[index])


def _sample(run: Run, sample: Sample) -> GallerySample:
    """Create one sample. Raises OSError and BrokenPicture."""
    truth = _read(sample_path(run.folder, sample.seq, TRUTH))
    height, width = truth.shape[:2]
    pictures = {"received": upscale_bicubic(_read(sample_path(run.folder, sample.seq, JPEG)), width, height)}
    if (path := enhanced_path(run.folder, sample.seq)) is not None:
        pictures["enhanced"] = upscale_bicubic(_read(path), width, height)
    differences = {f"{name}, difference × {AMPLIFICATION}": _difference(each, truth) for name, each in pictures.items()}
    scores = {"received": _scores(run, sample.seq, "original"), "enhanced": _scores(run, sample.seq, "enhanced")}
    shown = {**pictures, "ground truth": truth, **differences}
    known = run.sampled.known[sample.seq]
    apart = "" if known.psnr_db is None else f" ({known.psnr_db:.1f} dB apart)"
    remark = f"Rendering it again gave a different frame{apart}: ground truth may not belong to this frame."
    return GallerySample(
        title=f"{run.name}, {sample.seq}",
        about=_about(sample),
        remark=remark if known.identical is False else None,
        pictures=[
            ShownPicture(name, _data_url(each, SAMPLE_WIDTH), scores.get(name, "")) for name, each in shown.items()
        ],
        width=min(width, SAMPLE_WIDTH),
        height=round(height * min(1.0, SAMPLE_WIDTH / width)),
    )


def _about(sample: Sample) -> str:
    parts = [f"shown at {sample.at / 1000:.1f} s", f"{sample.bytes / 1000:.1f} kB"]
    if sample.rung is not None:
        parts.append(f"rung {sample.rung}")
    parts += [name for name in (sample.restore, sample.upscale) if name != "off"]
    if sample.enhance_ms is not None:
        parts.append(f"enhanced in {sample.enhance_ms:.1f} ms")
    return ", ".join(parts)


def _scores(run: Run, seq: int, kind: Kind) -> str:
    values = next((score.values for score in run.scores if score.key == (seq, kind)), {})
    return ", ".join(
        f"{metric.title} {values[metric.name]:.{metric.digits}f} {metric.unit}".rstrip()
        for metric in PICTURE_METRICS
        if metric.name in values
    )


def _read(path: Path) -> Picture:
    return decode(read_regular(path, MAX_PICTURE_BYTES, follow=False))


def _difference(one: Picture, other: Picture) -> Picture:
    difference: NDArray[np.int16] = np.abs(one.astype(np.int16) - other)
    return np.minimum(AMPLIFICATION * difference, 255).astype(np.uint8)


def _data_url(picture: Picture, width: int) -> str:
    image = Image.fromarray(picture)
    image.thumbnail((width, 4 * width))
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=80)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"
