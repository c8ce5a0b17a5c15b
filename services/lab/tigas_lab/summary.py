"""The figures of one run, from its folder."""

from __future__ import annotations

from pathlib import Path

from tigas_common.wire import WireModel
from tigas_lab import statistics
from tigas_lab.recording import BrokenRecording
from tigas_lab.statistics import Freezes, Latencies, Rates, Rungs
from tigas_lab.store import CaptureQuality, LinkSample, RunRecord, StoredRun


class QualityFigures(WireModel):
    """Over the kept pictures of a run."""

    pictures: int
    picture_psnr_db: float
    """Mean, against the pose that each was rendered from."""
    picture_ssim: float
    view_psnr_db: float
    """Mean, against the pose that the viewer had when it was on the screen."""
    view_ssim: float


class Figures(WireModel):
    """What a complete run says."""

    latencies: Latencies
    frames: Rates
    freezes: Freezes
    rungs: Rungs
    mean_height: float | None
    """Of the frames shown, weighted by time, in pixels."""
    received_kbps: float | None
    """By the page: frames or segments."""
    delivered_kbps: float | None
    """By the link towards the client: everything, with headers."""
    sent_kbps: float | None
    """By the link from the client."""
    target_kbps: float | None
    """The link's rate towards the client, mean."""
    trace_start_ms: float | None
    """The trace's position when the run began."""
    drops: int | None
    quality: QualityFigures | None


class Summary(WireModel):
    """A run with its figures, or with the reason why there are none."""

    folder: str
    record: RunRecord
    figures: Figures | None
    problem: str | None


def summarise(folder: Path) -> Summary:
    """Read a run's folder. Raises BrokenRecording if not even run.json can be read."""
    stored = StoredRun(folder)
    record = stored.record
    if record.status != "complete":
        reason = record.problem or "The run is incomplete: it was never ended."
        return Summary(folder=folder.name, record=record, figures=None, problem=reason)
    try:
        return Summary(folder=folder.name, record=record, figures=figures(stored), problem=None)
    except BrokenRecording as error:
        return Summary(folder=folder.name, record=record, figures=None, problem=str(error))


def figures(stored: StoredRun) -> Figures:
    """All figures of a complete run. Raises BrokenRecording."""
    head = stored.record.recording
    if head is None:
        raise BrokenRecording(f"{stored.folder / 'run.json'} says nothing of the recording.")
    duration = head.duration_ms
    inputs, frames = stored.inputs(), stored.frames()
    link = [sample for sample in stored.link() if 0 <= sample.at <= duration]
    return Figures(
        latencies=statistics.latencies(inputs, frames),
        frames=statistics.rates(frames, duration),
        freezes=statistics.freezes(inputs, frames, head.ended_ms),
        rungs=statistics.rungs(frames, duration),
        mean_height=statistics.mean_height(frames, duration),
        received_kbps=statistics.received_kbps(stored.traffic(), duration),
        delivered_kbps=statistics.mean_over_time([(sample.at, sample.delivered_kbps) for sample in link]),
        sent_kbps=statistics.mean_over_time([(sample.at, sample.up_delivered_kbps) for sample in link]),
        target_kbps=statistics.mean_over_time([(sample.at, sample.target_kbps) for sample in link]),
        trace_start_ms=_trace_start(link),
        drops=link[-1].drops - link[0].drops if link else None,
        quality=_quality(stored.quality()),
    )


def _trace_start(link: list[LinkSample]) -> float | None:
    first = next((sample for sample in link if sample.position_ms is not None), None)
    return None if first is None or first.position_ms is None else first.position_ms - first.at


def _quality(entries: list[CaptureQuality]) -> QualityFigures | None:
    if not entries:
        return None

    def mean(values: list[float]) -> float:
        return sum(values) / len(values)

    return QualityFigures(
        pictures=len(entries),
        picture_psnr_db=mean([entry.picture.psnr_db for entry in entries]),
        picture_ssim=mean([entry.picture.ssim for entry in entries]),
        view_psnr_db=mean([entry.view.psnr_db for entry in entries]),
        view_ssim=mean([entry.view.ssim for entry in entries]),
    )
