"""Pictures on the page: samples with their ground truth and differences, and a snapshot of each run."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.files import read_regular
from tigas_experiments.quality.metrics import PICTURE_METRICS
from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, enlarged, upscaled
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.rerendered import TRUTH, SampledRun
from tigas_experiments.records.samples import JPEG, MAX_PICTURE_BYTES, enhanced_path, sample_path
from tigas_experiments.records.scores import Score
from tigas_experiments.records.triplets import Kind
from tigas_experiments.report.results import Results, Run
from tigas_experiments.wire.recording import Sample

MOST = 6
"""Samples in a report, from as many of its runs as possible."""
MOST_PER_RUN = 3
SAMPLE_WIDTH, SNAPSHOT_WIDTH = 960, 640
AMPLIFIED = 4
"""Amplification of shown differences."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture as a data: URL."""

    name: str
    url: str
    scores: str
    """Formatted scores against ground truth, as far as computed."""


@dataclass(frozen=True, slots=True)
class GallerySample:
    """One sample, with pictures in the size of its ground truth."""

    title: str
    """Run and sequence number."""
    about: str
    remark: str | None
    """Warning about its ground truth."""
    pictures: tuple[Shown, ...]
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The screen and the viewer's correct view at one moment of a run, as data: URLs."""

    title: str
    at_s: float
    shown: str
    view: str


def snapshots(folder: Path, runs: Sequence[Run], titles: Mapping[str, str]) -> list[Snapshot]:
    """Snapshots of the runs that kept one, without broken ones."""
    found: list[Snapshot] = []
    for run in runs:
        with suppress(BrokenRecording, BrokenPicture):
            if (stored := StoredRun(folder / "runs" / run.folder).snapshot()) is not None:
                at, shown, view = stored[0], decode(stored[1]), decode(stored[2])
                height, width = view.shape[:2]
                urls = (_url(each, SNAPSHOT_WIDTH, "JPEG", 82) for each in (enlarged(shown, width, height), view))
                found.append(Snapshot(titles[run.folder], at / 1000, *urls))
    return found


def gallery(results: Results, runs: Mapping[str, SampledRun]) -> list[GallerySample]:
    """Samples of an experiment's runs (by folder name), without samples that are broken or lack ground truth."""
    rendered = [run for run in results.runs if run.folder in runs and runs[run.folder].known]
    chosen = rendered[:: -(-len(rendered) // MOST) or 1]  # spread over all runs
    of_each = (_of_run(results.folder / "runs" / run.folder, runs[run.folder], run.scores) for run in chosen)
    in_turns = chain.from_iterable(zip_longest(*(islice(one, MOST_PER_RUN) for one in of_each)))
    return list(islice((one for one in in_turns if one is not None), MOST))


def _of_run(folder: Path, run: SampledRun, scores: Sequence[Score]) -> Iterator[GallerySample]:
    """Samples from the beginning, middle and end of a run, then the others; made lazily."""
    samples = sorted((one for one in run.samples if one.seq in run.known), key=lambda sample: sample.at)
    first = [len(samples) * share // 6 for share in (1, 3, 5)] if len(samples) >= MOST_PER_RUN else []
    for index in dict.fromkeys((*first, *range(len(samples)))):
        try:
            yield _sample(folder, run, scores, samples[index])
        except (OSError, BrokenPicture):
            continue


def _sample(folder: Path, run: SampledRun, scores: Iterable[Score], sample: Sample) -> GallerySample:
    """Raises OSError and BrokenPicture."""
    truth = _read(sample_path(folder, sample.seq, TRUTH))
    height, width = truth.shape[:2]
    original = upscaled(_read(sample_path(folder, sample.seq, JPEG)), width, height)
    texts = _scores_by_kind(scores, sample.seq)
    pictures = [("received", original, texts.get("original", "")), ("ground truth", truth, "")]
    differences = [(f"received, difference × {AMPLIFIED}", _difference(original, truth), "")]
    if (path := enhanced_path(folder, sample.seq)) is not None:
        enhanced = upscaled(_read(path), width, height)
        pictures.insert(1, ("enhanced", enhanced, texts.get("enhanced", "")))
        differences.append((f"enhanced, difference × {AMPLIFIED}", _difference(enhanced, truth), ""))
    known = run.known.get(sample.seq)
    remark = None
    if known is not None and known.identical is False:
        apart = "" if known.psnr_db is None else f" ({known.psnr_db:.1f} dB apart)"
        remark = f"Rendering it again gave a different frame{apart}: ground truth may not belong to this frame."
    return GallerySample(
        title=f"{run.folder}, {sample.seq}",
        about=_about(sample),
        remark=remark,
        pictures=tuple(
            Shown(name, _url(picture, SAMPLE_WIDTH, "WEBP", 80), scored)
            for name, picture, scored in (*pictures, *differences)
        ),
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


def _scores_by_kind(scores: Iterable[Score], seq: int) -> dict[Kind, str]:
    """Formatted scores of a sample's pictures."""
    return {
        score.picture: ", ".join(
            f"{metric.title} {score.values[metric.name]:.{metric.digits}f} {metric.unit}".rstrip()
            for metric in PICTURE_METRICS
            if score.has([metric.name])
        )
        for score in scores
        if score.seq == seq
    }


def _read(path: Path) -> Picture:
    return decode(read_regular(path, MAX_PICTURE_BYTES, follow=False))


def _difference(one: Picture, other: Picture) -> Picture:
    difference: NDArray[np.int16] = np.abs(one.astype(np.int16) - other)
    return np.minimum(AMPLIFIED * difference, 255).astype(np.uint8)


def _url(picture: Picture, width: int, kind: str, quality: int) -> str:
    image = Image.fromarray(picture)
    image.thumbnail((width, 4 * width))
    buffer = io.BytesIO()
    image.save(buffer, kind, quality=quality)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(buffer.getvalue()).decode()}"
