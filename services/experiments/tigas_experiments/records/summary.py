"""The results of one run, from its folder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records import statistics
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.folder import RunRecord, StoredRun
from tigas_experiments.records.scores import Score, read_scores
from tigas_experiments.wire.figures import USUAL_INTERVAL_MS
from tigas_experiments.wire.recording import Input, LinkSample, Recording, Reply, Request, ShownFrame, Traffic


class Figures(BaseModel):
    """Results of a complete run."""

    values: dict[str, float | None]
    """By name in `report.metrics.METRICS`; None or missing if not measured."""
    rungs: dict[int, float]
    """Each rung's share of the time on screen."""


class Summary(WireModel):
    """A run with its results, or the reason why it has none."""

    folder: str
    record: RunRecord
    figures: Figures | None
    problem: str | None


@dataclass(frozen=True, slots=True)
class Records:
    recording: Recording
    link: Sequence[LinkSample]
    """Samples during the movement."""
    quality: Sequence[CaptureQuality]
    scores: Sequence[Score]
    """Scores of sampled pictures."""
    scores_problem: str | None
    """Reason why the scores are unreadable, which does not invalidate the run."""

    @classmethod
    def read(cls, stored: StoredRun) -> Records:
        """Read the records of a complete run. Raises BrokenRecording."""
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
    """Read a run's folder. Raises BrokenRecording if even run.json is unreadable."""
    return read(folder)[0]


def read(folder: Path) -> tuple[Summary, Records | None]:
    """A run's summary, and its records if it has results. Raises BrokenRecording as `summarise` does."""
    stored = StoredRun(folder)
    record = stored.record
    records, problem = None, record.problem or "The run is incomplete: it did not finish."
    if record.status == "complete":
        try:
            records = Records.read(stored)
        except BrokenRecording as error:
            problem = str(error)
    if records is None:
        return Summary(folder=folder.name, record=record, figures=None, problem=problem), None
    return Summary(folder=folder.name, record=record, figures=figures(records), problem=None), records


def figures(records: Records) -> Figures:
    recording, link = records.recording, records.link
    inputs, frames, duration = recording.inputs, recording.frames, recording.duration_ms
    interval, minutes = recording.display_interval_ms or USUAL_INTERVAL_MS, duration / 60_000
    parts = statistics.age_parts(inputs, frames, recording.replies)
    frozen = statistics.freezes(inputs, frames, recording.ended_ms)
    rungs = statistics.rungs(frames, duration)
    values: statistics.Values = {
        **statistics.latencies(inputs, frames, interval),
        **statistics.view_latencies(inputs, frames),
        **statistics.frame_ages(inputs, frames),
        **{f"age_{part}_ms": ms for part, ms in parts.items()},
        **statistics.content_ages(inputs, frames, duration, interval),
        **statistics.response_times(recording.replies),
        **statistics.requests(recording.requests),
        **statistics.render_times(recording.replies),
        **statistics.rates(frames, duration),
        "freezes_per_min": len(frozen) / minutes,
        "frozen_s": sum(frozen) * 1e-3,
        "mean_height_px": statistics.mean_height(frames, duration),
        "median_height_px": statistics.median_height(frames, duration),
        "border_filled_pct": _scaled(statistics.filled_share(frames, duration), 100),
        **statistics.warp_times(frames, duration),
        "received_mbit_s": _scaled(statistics.received_kbps(recording.traffic, duration), 1e-3),
        **_link(link),
        **(_quality(records.quality, records.scores) if records.quality else {}),
    }
    if rungs:
        values["mean_profile"] = sum(rung * share for rung, share in rungs.items())
        values["profile_changes_per_min"] = statistics.rung_changes(frames, duration) / minutes
    if (local := recording.local) is not None:
        for name, ms in (("first_picture_s", local.first_picture_ms), ("whole_scene_s", local.complete_ms)):
            values[name] = math.inf if ms is None else (local.began_ms + ms) / 1000
    return Figures(values=values, rungs=rungs)


def _link(samples: Sequence[LinkSample]) -> statistics.Values:
    delivered = statistics.mean_over_time([(sample.at, sample.delivered_kbps) for sample in samples])
    target = statistics.mean_over_time([(sample.at, sample.target_kbps) for sample in samples])
    began = next((sample.position_ms - sample.at for sample in samples if sample.position_ms is not None), None)
    return {
        "over_link_mbit_s": _scaled(delivered, 1e-3),
        "link_mbit_s": _scaled(target, 1e-3),
        "trace_began_s": _scaled(began, 1e-3),
        "lost_packets": samples[-1].drops - samples[0].drops if samples else None,
    }


def _quality(entries: Sequence[CaptureQuality], scores: Sequence[Score]) -> statistics.Values:
    means: statistics.Values = {}
    for name in ("picture", "view", "seen"):
        known = [quality for entry in entries if (quality := getattr(entry, name)) is not None]
        means[f"{name}_psnr_db"] = statistics.mean([quality.psnr_db for quality in known])
        means[f"{name}_ssim"] = statistics.mean([quality.ssim for quality in known])
    uncovered = statistics.mean([entry.uncovered for entry in entries if entry.uncovered is not None])
    lpips = [score.lpips for score in scores if score.picture == "seen" and score.lpips is not None]
    return {**means, "border_never_seen_pct": _scaled(uncovered, 100), "seen_lpips": statistics.mean(lpips)}


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor
