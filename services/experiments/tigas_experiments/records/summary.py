"""The figures of one run, from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.picture import CaptureQuality, Quality
from tigas_experiments.records import statistics
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, StoredRun
from tigas_experiments.records.scores import Score, read_scores
from tigas_experiments.wire.figures import USUAL_INTERVAL_MS, Figures, QualityFigures
from tigas_experiments.wire.recording import (
    Input,
    LinkSample,
    Recording,
    RecordingHead,
    Reply,
    Request,
    ShownFrame,
    Traffic,
)


class Summary(WireModel):
    """A run with its figures, or with the reason for their absence."""

    folder: str
    record: RunRecord
    figures: Figures | None
    problem: str | None


@dataclass(frozen=True, slots=True)
class Records:
    """Records of a complete run, read once."""

    head: RecordingHead
    inputs: list[Input]
    frames: list[ShownFrame]
    replies: list[Reply]
    requests: list[Request]
    traffic: list[Traffic]
    link: list[LinkSample]
    """While the movement lasted."""
    quality: list[CaptureQuality]
    scores: list[Score]
    """Scores of sampled pictures."""
    scores_problem: str | None
    """Reason why the scores are unreadable, which does not invalidate the run."""

    @classmethod
    def of_recording(cls, recording: Recording, link: Sequence[LinkSample]) -> Records:
        """Records of a page's recording, which has no pictures."""
        return cls(
            head=recording.head,
            inputs=list(recording.inputs),
            frames=list(recording.frames),
            replies=list(recording.replies),
            requests=list(recording.requests),
            traffic=list(recording.traffic),
            link=[sample for sample in link if 0 <= sample.at <= recording.duration_ms],
            quality=[],
            scores=[],
            scores_problem=None,
        )

    @classmethod
    def of(cls, stored: StoredRun) -> Records:
        """Raises BrokenRecording."""
        head = stored.record.recording
        if head is None:
            raise BrokenRecording(f"{stored.folder / 'run.json'} says nothing of the recording.")
        scores: list[Score] = []
        scores_problem = None
        try:
            scores = read_scores(stored.folder)
        except BrokenRecording as error:
            scores_problem = str(error)
        return cls(
            head=head,
            inputs=stored.inputs(),
            frames=stored.frames(),
            replies=stored.replies(),
            requests=stored.requests(),
            traffic=stored.traffic(),
            link=[sample for sample in stored.link() if 0 <= sample.at <= head.duration_ms],
            quality=stored.quality(),
            scores=scores,
            scores_problem=scores_problem,
        )


def summarise(folder: Path) -> Summary:
    """Read a run's folder. Raises BrokenRecording if not even run.json can be read."""
    return read(folder)[0]


def read(folder: Path) -> tuple[Summary, Records | None]:
    """A run's summary, with its records where there are figures. Raises BrokenRecording as `summarise` does."""
    stored = StoredRun(folder)
    record = stored.record
    if record.status != "complete":
        reason = record.problem or "The run is incomplete: it was never ended."
        return Summary(folder=folder.name, record=record, figures=None, problem=reason), None
    try:
        records = Records.of(stored)
    except BrokenRecording as error:
        return Summary(folder=folder.name, record=record, figures=None, problem=str(error)), None
    return Summary(folder=folder.name, record=record, figures=figures(records), problem=None), records


def figures(records: Records) -> Figures:
    """All figures of a complete run."""
    inputs, frames, link, duration = records.inputs, records.frames, records.link, records.head.duration_ms
    interval = records.head.display_interval_ms or USUAL_INTERVAL_MS
    return Figures(
        latencies=statistics.latencies(inputs, frames, interval),
        view_latencies=statistics.view_latencies(inputs, frames),
        frame_ages=statistics.frame_ages(inputs, frames),
        content_ages=statistics.content_ages(inputs, frames, duration, interval),
        response_times=statistics.response_times(records.replies),
        requests=statistics.requests(records.requests),
        render_times=statistics.render_times(records.replies),
        frames=statistics.rates(frames, duration),
        freezes=statistics.freezes(inputs, frames, records.head.ended_ms),
        rungs=statistics.rungs(frames, duration),
        mean_height=statistics.mean_height(frames, duration),
        median_height=statistics.median_height(frames, duration),
        filled=statistics.filled(frames, duration),
        warp_times=statistics.warp_times(frames, duration),
        received_kbps=statistics.received_kbps(records.traffic, duration),
        delivered_kbps=statistics.mean_over_time([(sample.at, sample.delivered_kbps) for sample in link]),
        sent_kbps=statistics.mean_over_time([(sample.at, sample.up_delivered_kbps) for sample in link]),
        target_kbps=statistics.mean_over_time([(sample.at, sample.target_kbps) for sample in link]),
        trace_start_ms=_trace_start(link),
        drops=link[-1].drops - link[0].drops if link else None,
        quality=_quality(records.quality, records.scores),
    )


def _trace_start(link: list[LinkSample]) -> float | None:
    first = next((sample for sample in link if sample.position_ms is not None), None)
    return None if first is None or first.position_ms is None else first.position_ms - first.at


def _quality(entries: list[CaptureQuality], scores: list[Score]) -> QualityFigures | None:
    if not entries:
        return None

    def means(found: list[Quality | None]) -> tuple[float | None, float | None]:
        known = [quality for quality in found if quality is not None]
        if not known:
            return None, None
        return sum(q.psnr_db for q in known) / len(known), sum(q.ssim for q in known) / len(known)

    picture_psnr, picture_ssim = means([entry.picture for entry in entries])
    view_psnr, view_ssim = means([entry.view for entry in entries])
    seen_psnr, seen_ssim = means([entry.seen for entry in entries])
    uncovered = [entry.uncovered for entry in entries if entry.uncovered is not None]
    lpips = [score.lpips for score in scores if score.picture == "seen" and score.lpips is not None]
    return QualityFigures(
        pictures=len(entries),
        picture_psnr_db=picture_psnr,
        picture_ssim=picture_ssim,
        view_psnr_db=view_psnr,
        view_ssim=view_ssim,
        seen_psnr_db=seen_psnr,
        seen_ssim=seen_ssim,
        uncovered=sum(uncovered) / len(uncovered) if uncovered else None,
        seen_lpips=sum(lpips) / len(lpips) if lpips else None,
    )
