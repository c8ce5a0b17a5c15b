"""A few samples of an experiment's runs: what came, what was shown, ground truth, and how far they are apart."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.files import read_regular
from tigas_common.wire.recording import Sample
from tigas_experiments.quality.metrics import PICTURE_METRICS, PictureMetric
from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, upscaled
from tigas_experiments.records.materialised import TRUTH, SampledRun
from tigas_experiments.records.samples import ENHANCED, JPEG, MAX_PICTURE_BYTES, sample_path
from tigas_experiments.records.scores import Score
from tigas_experiments.records.triplets import Kind
from tigas_experiments.report.results import Results

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
    scores: str
    """Against ground truth, as far as they were computed."""


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


def gallery(results: Results, runs: Mapping[str, SampledRun]) -> list[GallerySample]:
    """Of an experiment's sampled runs, by the names of their folders; without what has no ground truth or is broken."""
    rendered = [run for run in results.runs if run.folder in runs and runs[run.folder].known]
    chosen = rendered[:: -(-len(rendered) // MOST) or 1]  # spread over all of them
    of_each = (_of_run(results.folder / "runs" / run.folder, runs[run.folder], run.scores) for run in chosen)
    in_turns = chain.from_iterable(zip_longest(*(islice(one, MOST_A_RUN) for one in of_each)))
    return list(islice((one for one in in_turns if one is not None), MOST))


def _of_run(folder: Path, run: SampledRun, scores: Sequence[Score]) -> Iterator[GallerySample]:
    """From the run's beginning, middle and end, then others; each is made when it is asked for."""
    samples = sorted((one for one in run.samples if one.seq in run.known), key=lambda sample: sample.at)
    first = [len(samples) * share // 6 for share in (1, 3, 5)] if len(samples) >= MOST_A_RUN else []
    for index in dict.fromkeys((*first, *range(len(samples)))):
        try:
            yield _sample(folder, run, scores, samples[index])
        except (OSError, BrokenPicture):
            continue


def _sample(folder: Path, run: SampledRun, scores: Iterable[Score], sample: Sample) -> GallerySample:
    """Raises OSError and BrokenPicture."""
    truth = _read(folder, sample, TRUTH)
    height, width = truth.shape[:2]
    original = upscaled(_read(folder, sample, JPEG), width, height)
    told = _by_kind(scores, sample.seq)
    pictures = [("as it came", original, told.get("original", "")), ("ground truth", truth, "")]
    differences = [(f"as it came, difference × {TIMES}", _apart(original, truth), "")]
    if (kind := next((kind for kind in ENHANCED if sample_path(folder, sample.seq, kind).exists()), None)) is not None:
        enhanced = upscaled(_read(folder, sample, kind), width, height)
        pictures.insert(1, ("enhanced", enhanced, told.get("enhanced", "")))
        differences.append((f"enhanced, difference × {TIMES}", _apart(enhanced, truth), ""))
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
        pictures=tuple(Shown(name, _url(picture), scored) for name, picture, scored in (*pictures, *differences)),
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


def _by_kind(scores: Iterable[Score], seq: int) -> dict[Kind, str]:
    """What was computed of a sample's pictures."""
    return {
        score.picture: ", ".join(_text(metric, score) for metric in PICTURE_METRICS if score.has([metric.name]))
        for score in scores
        if score.seq == seq
    }


def _text(metric: PictureMetric, score: Score) -> str:
    return f"{metric.title} {score.values[metric.name]:.{metric.digits}f} {metric.unit}".rstrip()


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
