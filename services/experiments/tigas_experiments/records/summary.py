"""The figures of one run, from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.picture import CaptureQuality
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
    head: RecordingHead
    inputs: Sequence[Input]
    frames: Sequence[ShownFrame]
    replies: Sequence[Reply]
    requests: Sequence[Request]
    traffic: Sequence[Traffic]
    link: Sequence[LinkSample]
    """While the movement lasted."""
    quality: Sequence[CaptureQuality] = ()
    scores: Sequence[Score] = ()
    """Scores of sampled pictures."""
    scores_problem: str | None = None
    """Reason why the scores are unreadable, which does not invalidate the run."""

    @classmethod
    def of_recording(cls, recording: Recording, link: Sequence[LinkSample]) -> Records:
        """Records of a page's recording, which has no pictures."""
        return cls(
            head=recording.head,
            inputs=recording.inputs,
            frames=recording.frames,
            replies=recording.replies,
            requests=recording.requests,
            traffic=recording.traffic,
            link=_during(link, recording.head),
        )

    @classmethod
    def of(cls, stored: StoredRun) -> Records:
        """Records of a run's folder. Raises BrokenRecording."""
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
            link=_during(stored.link(), head),
            quality=stored.quality(),
            scores=scores,
            scores_problem=scores_problem,
        )


def summarise(folder: Path) -> Summary:
    """Read a run's folder. Raises BrokenRecording if not even run.json can be read."""
    return read(folder)[0]


def read(folder: Path) -> tuple[Summary, Records | None]:
    """A run's summary, with its records if there are figures. Raises BrokenRecording as `summarise` does."""
    stored = StoredRun(folder)
    record = stored.record
    records, problem = None, record.problem or "The run is incomplete: it was never ended."
    if record.status == "complete":
        try:
            records = Records.of(stored)
        except BrokenRecording as error:
            problem = str(error)
    if records is None:
        return Summary(folder=folder.name, record=record, figures=None, problem=problem), None
    return Summary(folder=folder.name, record=record, figures=figures(records), problem=None), records


def figures(records: Records) -> Figures:
    inputs, frames, link, duration = records.inputs, records.frames, records.link, records.head.duration_ms
    interval = records.head.display_interval_ms or USUAL_INTERVAL_MS
    start = next((sample for sample in link if sample.position_ms is not None), None)
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
        trace_start_ms=None if start is None or start.position_ms is None else start.position_ms - start.at,
        drops=link[-1].drops - link[0].drops if link else None,
        quality=_quality(records.quality, records.scores) if records.quality else None,
    )


def _quality(entries: Sequence[CaptureQuality], scores: Sequence[Score]) -> QualityFigures:
    means: dict[str, float | None] = {}
    for name in ("picture", "view", "seen"):
        known = [quality for entry in entries if (quality := getattr(entry, name)) is not None]
        means[f"{name}_psnr_db"] = statistics.mean([quality.psnr_db for quality in known])
        means[f"{name}_ssim"] = statistics.mean([quality.ssim for quality in known])
    return QualityFigures(
        pictures=len(entries),
        **means,
        uncovered=statistics.mean([entry.uncovered for entry in entries if entry.uncovered is not None]),
        seen_lpips=statistics.mean(
            [score.lpips for score in scores if score.picture == "seen" and score.lpips is not None]
        ),
    )


def _during(link: Sequence[LinkSample], head: RecordingHead) -> list[LinkSample]:
    return [sample for sample in link if 0 <= sample.at <= head.duration_ms]
