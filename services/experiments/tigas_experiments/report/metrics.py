"""The figures that reports have of each run, one definition for CSV files, tables and plots."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from tigas_common.wire.figures import Figures, QualityFigures
from tigas_experiments.records.folder import RunRecord

Value = float | None
NEVER = "never"
NONE = "–"


@dataclass(frozen=True, slots=True)
class Metric:
    """One figure. inf: so many inputs were never answered that there is no such time."""

    name: str
    """Its column in the CSV files, with its unit."""
    title: str
    unit: str
    digits: int
    better: Literal["low", "high"] | None
    of: Callable[[RunRecord, Figures], Value]

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    def text(self, value: Value) -> str:
        """As a person reads it, without the unit."""
        if value is None:
            return NONE
        return NEVER if math.isinf(value) else f"{value:,.{self.digits}f}"

    def with_unit(self, value: float) -> str:
        """As it stands in a sentence."""
        if math.isinf(value) or not self.unit:
            return self.text(value)
        return f"{self.text(value)}{'' if self.unit.startswith('/') else ' '}{self.unit}"


def _minutes(record: RunRecord) -> float:
    return (record.recording.duration_ms if record.recording else record.configuration.duration_s * 1000) / 60_000


def _answered(percentile: Callable[[Figures], Value]) -> Callable[[RunRecord, Figures], Value]:
    def of(_: RunRecord, figures: Figures) -> Value:
        value = percentile(figures)
        return math.inf if value is None and figures.latencies.unanswered else value

    return of


def _plain(of: Callable[[Figures], Value]) -> Callable[[RunRecord, Figures], Value]:
    return lambda _, figures: of(figures)


def _quality(of: Callable[[QualityFigures], float]) -> Callable[[RunRecord, Figures], Value]:
    return lambda _, figures: None if figures.quality is None else of(figures.quality)


def _scaled(value: Value, factor: float) -> Value:
    return None if value is None else value * factor


PHOTON_P50 = Metric(
    "motion_to_photon_p50_ms", "Motion-to-photon p50", "ms", 0, "low", _answered(lambda f: f.latencies.p50)
)
PHOTON_P95 = Metric(
    "motion_to_photon_p95_ms", "Motion-to-photon p95", "ms", 0, "low", _answered(lambda f: f.latencies.p95)
)
PHOTON_P99 = Metric(
    "motion_to_photon_p99_ms", "Motion-to-photon p99", "ms", 0, "low", _answered(lambda f: f.latencies.p99)
)
IN_TIME = Metric(
    "inputs_within_100ms_pct",
    "Inputs within 100 ms",
    "%",
    1,
    "high",
    _plain(lambda f: _scaled(f.latencies.share_interactive, 100)),
)
RESPONSE_MEAN = Metric("response_mean_ms", "Mean response", "ms", 0, "low", _plain(lambda f: f.responses.mean))
RESPONSE_P50 = Metric("response_p50_ms", "Response p50", "ms", 0, "low", _plain(lambda f: f.responses.p50))
RESPONSE_P95 = Metric("response_p95_ms", "Response p95", "ms", 0, "low", _plain(lambda f: f.responses.p95))
REPLY_MEAN = Metric("reply_mean_ms", "Mean reply time", "ms", 0, "low", _plain(lambda f: f.reply_times.mean))
REPLY_P50 = Metric("reply_p50_ms", "Reply time p50", "ms", 0, "low", _plain(lambda f: f.reply_times.p50))
REPLY_P95 = Metric("reply_p95_ms", "Reply time p95", "ms", 0, "low", _plain(lambda f: f.reply_times.p95))
NEW_VIEWS = Metric("new_views_per_s", "New views", "/s", 1, "high", _plain(lambda f: f.frames.new_views_per_s))
HEIGHT = Metric("mean_height_px", "Mean height", "px", 0, "high", _plain(lambda f: f.mean_height))
PROFILE = Metric("mean_profile", "Mean profile (0 is best)", "", 2, "low", _plain(lambda f: f.rungs.mean))
SWITCHES = Metric(
    "profile_changes_per_min",
    "Profile changes",
    "/min",
    1,
    "low",
    lambda record, f: f.rungs.switches / _minutes(record) if f.rungs.share else None,
)
RECEIVED = Metric("received_mbit_s", "Received", "Mbit/s", 1, None, _plain(lambda f: _scaled(f.received_kbps, 1e-3)))
OVER_LINK = Metric(
    "over_link_mbit_s", "Over the link", "Mbit/s", 1, None, _plain(lambda f: _scaled(f.delivered_kbps, 1e-3))
)
FREEZES = Metric("freezes_per_min", "Freezes", "/min", 1, "low", lambda record, f: f.freezes.count / _minutes(record))
FROZEN = Metric("frozen_s", "Frozen", "s", 1, "low", _plain(lambda f: f.freezes.total_ms / 1000))
PICTURE_SSIM = Metric("picture_ssim", "SSIM of the picture", "", 3, "high", _quality(lambda q: q.picture_ssim))
PICTURE_PSNR = Metric("picture_psnr_db", "PSNR of the picture", "dB", 1, "high", _quality(lambda q: q.picture_psnr_db))
VIEW_SSIM = Metric("view_ssim", "SSIM of the view", "", 3, "high", _quality(lambda q: q.view_ssim))
VIEW_PSNR = Metric("view_psnr_db", "PSNR of the view", "dB", 1, "high", _quality(lambda q: q.view_psnr_db))

METRICS = (
    PHOTON_P50,
    PHOTON_P95,
    PHOTON_P99,
    IN_TIME,
    Metric("inputs", "Inputs", "", 0, None, _plain(lambda f: f.latencies.inputs)),
    Metric("inputs_unanswered", "Unanswered inputs", "", 0, "low", _plain(lambda f: f.latencies.unanswered)),
    RESPONSE_MEAN,
    RESPONSE_P50,
    RESPONSE_P95,
    REPLY_MEAN,
    REPLY_P50,
    REPLY_P95,
    NEW_VIEWS,
    Metric("frames_per_s", "Frames", "/s", 1, None, _plain(lambda f: f.frames.per_s)),
    FREEZES,
    FROZEN,
    HEIGHT,
    PROFILE,
    SWITCHES,
    RECEIVED,
    OVER_LINK,
    Metric("link_mbit_s", "Link's rate", "Mbit/s", 1, None, _plain(lambda f: _scaled(f.target_kbps, 1e-3))),
    Metric("lost_packets", "Lost packets", "", 0, None, _plain(lambda f: f.drops)),
    PICTURE_SSIM,
    PICTURE_PSNR,
    VIEW_SSIM,
    VIEW_PSNR,
)
TABLE = (
    PHOTON_P50,
    PHOTON_P95,
    IN_TIME,
    RESPONSE_MEAN,
    RESPONSE_P95,
    NEW_VIEWS,
    HEIGHT,
    PROFILE,
    SWITCHES,
    RECEIVED,
    VIEW_SSIM,
)
"""Those that a page has room for."""
