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
from tigas_experiments.wire.recording import Input, LinkSample, Recording, Reply, Request, ShownFrame, Traffic


class Summary(WireModel):
    """A run with its figures, or with the reason for their absence."""

    folder: str
    record: RunRecord
    figures: Figures | None
    problem: str | None


@dataclass(frozen=True, slots=True)
class Records:
    recording: Recording
    link: Sequence[LinkSample]
    """While the movement lasted."""
    quality: Sequence[CaptureQuality]
    scores: Sequence[Score]
    """Scores of sampled pictures."""
    scores_problem: str | None
    """Reason why the scores are unreadable, which does not invalidate the run."""

    @classmethod
    def of(cls, stored: StoredRun) -> Records:
        """Records of a complete run. Raises BrokenRecording."""
        head = stored.record.recording
        if head is None:
            raise BrokenRecording(f"{stored.folder / 'run.json'} does not describe the recording.")
        scores: list[Score] = []
        scores_problem = None
        try:
            scores = read_scores(stored.folder)
        except BrokenRecording as error:
            scores_problem = str(error)
        recording = Recording.model_construct(
            **dict(head),
            inputs=stored.read(Input),
            frames=stored.read(ShownFrame),
            replies=stored.read(Reply),
            requests=stored.read(Request),
            traffic=stored.read(Traffic),
        )
        link = [sample for sample in stored.read(LinkSample) if 0 <= sample.at <= head.duration_ms]
        return cls(recording, link, stored.read(CaptureQuality), scores, scores_problem)


def summarise(folder: Path) -> Summary:
    """Read a run's folder. Raises BrokenRecording if not even run.json can be read."""
    return read(folder)[0]


def read(folder: Path) -> tuple[Summary, Records | None]:
    """A run's summary, with its records if there are figures. Raises BrokenRecording as `summarise` does."""
    stored = StoredRun(folder)
    record = stored.record
    records, problem = None, record.problem or "The run is incomplete: it never ended."
    if record.status == "complete":
        try:
            records = Records.of(stored)
        except BrokenRecording as error:
            problem = str(error)
    if records is None:
        return Summary(folder=folder.name, record=record, figures=None, problem=problem), None
    return Summary(folder=folder.name, record=record, figures=figures(records), problem=None), records


def figures(records: Records) -> Figures:
    recording, link = records.recording, records.link
    inputs, frames, duration = recording.inputs, recording.frames, recording.duration_ms
    interval = recording.display_interval_ms or USUAL_INTERVAL_MS
    start = next((sample for sample in link if sample.position_ms is not None), None)
    return Figures(
        latencies=statistics.latencies(inputs, frames, interval),
        view_latencies=statistics.view_latencies(inputs, frames),
        frame_ages=statistics.frame_ages(inputs, frames),
        content_ages=statistics.content_ages(inputs, frames, duration, interval),
        response_times=statistics.response_times(recording.replies),
        requests=statistics.requests(recording.requests),
        render_times=statistics.render_times(recording.replies),
        frames=statistics.rates(frames, duration),
        freezes=statistics.freezes(inputs, frames, recording.ended_ms),
        rungs=statistics.rungs(frames, duration),
        mean_height=statistics.mean_height(frames, duration),
        median_height=statistics.median_height(frames, duration),
        filled=statistics.filled(frames, duration),
        warp_times=statistics.warp_times(frames, duration),
        received_kbps=statistics.received_kbps(recording.traffic, duration),
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
