"""A few samples of an experiment's runs: what came, what was shown, ground truth, and how far they are apart."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.files import read_regular
from tigas_common.wire.recording import Sample
from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, upscaled
from tigas_experiments.records.materialised import TRUTH, SampledRun
from tigas_experiments.records.samples import ENHANCED, JPEG, MAX_PICTURE_BYTES, sample_path

MOST = 6
"""Samples of a report, from as many of its runs as possible."""
MOST_A_RUN = 3
MAX_WIDTH = 960
WEBP_QUALITY = 80
TIMES = 4
"""Differences are shown so many times as large as they are."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture, as a data: URL."""

    name: str
    url: str


@dataclass(frozen=True, slots=True)
class GallerySample:
    """One sample; its pictures all have the size of its ground truth."""

    title: str
    """The run and the sequence number."""
    about: str
    remark: str | None
    """What must be known of it."""
    pictures: tuple[Shown, ...]
    width: int
    height: int


def gallery(folder: Path, runs: Mapping[str, SampledRun]) -> list[GallerySample]:
    """Of an experiment's sampled runs, by the names of their folders; without what has no ground truth or is broken."""
    rendered = [name for name, run in runs.items() if run.known]
    names = rendered[:: -(-len(rendered) // MOST) or 1]  # spread over all of them
    each = [islice(_of_run(folder / "runs" / name, runs[name]), MOST_A_RUN) for name in names]
    in_turns = chain.from_iterable(zip_longest(*each))
    return list(islice((one for one in in_turns if one is not None), MOST))


def _of_run(folder: Path, run: SampledRun) -> Iterator[GallerySample]:
    """From the run's beginning, middle and end, then others; each is made when it is asked for."""
    samples = sorted(run.samples, key=lambda sample: sample.at)
    first = [samples[len(samples) * share // 6] for share in (1, 3, 5)] if len(samples) >= MOST_A_RUN else []
    for sample in dict.fromkeys(sample.seq for sample in (*first, *samples)):
        try:
            yield _sample(folder, run, next(one for one in samples if one.seq == sample))
        except (OSError, BrokenPicture):
            continue


def _sample(folder: Path, run: SampledRun, sample: Sample) -> GallerySample:
    """Raises OSError and BrokenPicture."""
    truth = _read(folder, sample, TRUTH)
    height, width = truth.shape[:2]
    original = upscaled(_read(folder, sample, JPEG), width, height)
    pictures = [
        ("as it came", original),
        ("ground truth", truth),
        (f"as it came, difference × {TIMES}", _apart(original, truth)),
    ]
    if (kind := next((kind for kind in ENHANCED if sample_path(folder, sample.seq, kind).exists()), None)) is not None:
        enhanced = upscaled(_read(folder, sample, kind), width, height)
        pictures.insert(1, ("enhanced", enhanced))
        pictures.append((f"enhanced, difference × {TIMES}", _apart(enhanced, truth)))
    known = run.known.get(sample.seq)
    remark = None
    if known is not None and known.identical is False:
        apart = "" if known.psnr_db is None else f" ({known.psnr_db:.1f} dB apart)"
        remark = (
            f"The renderer answered differently when it was asked again{apart}: ground truth may not be this frame's."
        )
    return GallerySample(
        title=f"{run.folder}, {sample.seq}",
        about=_about(sample),
        remark=remark,
        pictures=tuple(Shown(name, _url(picture)) for name, picture in pictures),
        width=min(width, MAX_WIDTH),
        height=round(height * min(1.0, MAX_WIDTH / width)),
    )


def _about(sample: Sample) -> str:
    parts = [f"shown at {sample.at / 1000:.1f} s", f"{sample.bytes / 1000:.1f} kB"]
    if sample.rung is not None:
        parts.append(f"rung {sample.rung}")
    parts += [name for name in (sample.restore, sample.upscale) if name != "off"]
    if sample.enhance_ms is not None:
        parts.append(f"enhanced in {sample.enhance_ms:.1f} ms")
    return ", ".join(parts)


def _read(folder: Path, sample: Sample, kind: str) -> Picture:
    return decode(read_regular(sample_path(folder, sample.seq, kind), MAX_PICTURE_BYTES, follow=False))


def _apart(one: Picture, other: Picture) -> Picture:
    difference: NDArray[np.int16] = np.abs(one.astype(np.int16) - other)
    return np.minimum(TIMES * difference, 255).astype(np.uint8)


def _url(picture: Picture) -> str:
    image = Image.fromarray(picture)
    image.thumbnail((MAX_WIDTH, 4 * MAX_WIDTH))
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", quality=WEBP_QUALITY)
    return f"data:image/webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"
