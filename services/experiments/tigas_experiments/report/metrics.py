"""The figures that reports have of each run, one definition for CSV files, tables and plots."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from tigas_common.wire.figures import INTERACTIVE_MS, Figures, QualityFigures, Requests, ViewLatencies
from tigas_common.wire.recording import PlayedDownload
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


def _turned(percentile: Callable[[ViewLatencies], Value]) -> Callable[[RunRecord, Figures], Value]:
    def of(_: RunRecord, figures: Figures) -> Value:
        value = percentile(figures.view_latencies)
        return math.inf if value is None and figures.view_latencies.unanswered else value

    return of


def _plain(of: Callable[[Figures], Value]) -> Callable[[RunRecord, Figures], Value]:
    return lambda _, figures: of(figures)


def _of_download(time: Callable[[PlayedDownload], Value]) -> Callable[[RunRecord, Figures], Value]:
    """Seconds since the run began; inf if that never came."""

    def of(record: RunRecord, _: Figures) -> Value:
        local = None if record.recording is None else record.recording.local
        if local is None:
            return None
        ms = time(local)
        return math.inf if ms is None else (local.began_ms + ms) / 1000

    return of


def _quality(of: Callable[[QualityFigures], Value]) -> Callable[[RunRecord, Figures], Value]:
    return lambda _, figures: None if figures.quality is None else of(figures.quality)


def _requests(of: Callable[[Requests], int]) -> Callable[[RunRecord, Figures], Value]:
    return lambda _, figures: None if figures.requests is None else of(figures.requests)


def _scaled(value: Value, factor: float) -> Value:
    return None if value is None else value * factor


VIEW_LATENCY_P50 = Metric("view_latency_p50_ms", "View latency p50", "ms", 0, "low", _turned(lambda v: v.p50))
VIEW_LATENCY_P90 = Metric("view_latency_p90_ms", "View latency p90", "ms", 0, "low", _turned(lambda v: v.p90))
VIEW_LATENCY_P95 = Metric("view_latency_p95_ms", "View latency p95", "ms", 0, "low", _turned(lambda v: v.p95))
VIEW_LATENCY_P99 = Metric("view_latency_p99_ms", "View latency p99", "ms", 0, "low", _turned(lambda v: v.p99))
PHOTON_P50 = Metric(
    "motion_to_photon_p50_ms", "Motion-to-photon p50", "ms", 0, "low", _answered(lambda f: f.latencies.p50)
)
PHOTON_P90 = Metric(
    "motion_to_photon_p90_ms", "Motion-to-photon p90", "ms", 0, "low", _answered(lambda f: f.latencies.p90)
)
PHOTON_P95 = Metric(
    "motion_to_photon_p95_ms", "Motion-to-photon p95", "ms", 0, "low", _answered(lambda f: f.latencies.p95)
)
PHOTON_P99 = Metric(
    "motion_to_photon_p99_ms", "Motion-to-photon p99", "ms", 0, "low", _answered(lambda f: f.latencies.p99)
)
IN_TIME = Metric(
    f"inputs_within_{INTERACTIVE_MS:g}ms_pct",
    f"Inputs within {INTERACTIVE_MS:g} ms",
    "%",
    1,
    "high",
    _plain(lambda f: _scaled(f.latencies.share_interactive, 100)),
)
IN_TIME_FRAME_LESS = Metric(
    "inputs_within_a_frame_less_pct",
    "Inputs within a frame less",
    "%",
    1,
    "high",
    _plain(lambda f: _scaled(f.latencies.share_frame_less, 100)),
)
IN_TIME_FRAME_MORE = Metric(
    "inputs_within_a_frame_more_pct",
    "Inputs within a frame more",
    "%",
    1,
    "high",
    _plain(lambda f: _scaled(f.latencies.share_frame_more, 100)),
)
FRAME_AGE_MEAN = Metric("frame_age_mean_ms", "Mean frame age", "ms", 0, "low", _plain(lambda f: f.frame_ages.mean))
FRAME_AGE_P50 = Metric("frame_age_p50_ms", "Frame age p50", "ms", 0, "low", _plain(lambda f: f.frame_ages.p50))
FRAME_AGE_P95 = Metric("frame_age_p95_ms", "Frame age p95", "ms", 0, "low", _plain(lambda f: f.frame_ages.p95))
RESPONSE_TIME_MEAN = Metric(
    "response_time_mean_ms", "Mean response time", "ms", 0, "low", _plain(lambda f: f.response_times.mean)
)
RESPONSE_TIME_P50 = Metric(
    "response_time_p50_ms", "Response time p50", "ms", 0, "low", _plain(lambda f: f.response_times.p50)
)
RESPONSE_TIME_P95 = Metric(
    "response_time_p95_ms", "Response time p95", "ms", 0, "low", _plain(lambda f: f.response_times.p95)
)
RENDER_MEAN = Metric("render_mean_ms", "Mean rendering time", "ms", 1, "low", _plain(lambda f: f.render_times.mean))
RENDER_P50 = Metric("render_p50_ms", "Rendering time p50", "ms", 1, "low", _plain(lambda f: f.render_times.p50))
NEW_VIEWS = Metric("new_views_per_s", "New views", "/s", 1, "high", _plain(lambda f: f.frames.new_views_per_s))
HEIGHT = Metric("mean_height_px", "Mean height", "px", 0, "high", _plain(lambda f: f.mean_height))
MEDIAN_HEIGHT = Metric("median_height_px", "Median height", "px", 0, "high", _plain(lambda f: f.median_height))
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
SEEN_SSIM = Metric("seen_ssim", "SSIM of what is seen", "", 3, "high", _quality(lambda q: q.seen_ssim))
SEEN_PSNR = Metric("seen_psnr_db", "PSNR of what is seen", "dB", 1, "high", _quality(lambda q: q.seen_psnr_db))
FILLED = Metric(
    "border_filled_pct", "Border outside the newest frame", "%", 1, "low", _plain(lambda f: _scaled(f.filled, 100))
)
UNCOVERED = Metric(
    "border_never_seen_pct", "Border never seen", "%", 1, "low", _quality(lambda q: _scaled(q.uncovered, 100))
)
SEEN_LPIPS = Metric("seen_lpips", "LPIPS of what is seen", "", 3, "low", _quality(lambda q: q.seen_lpips))
WARP_MEAN = Metric(
    "warp_mean_ms", "Main thread per turned picture", "ms", 2, "low", _plain(lambda f: f.warp_times.mean)
)
WARP_P95 = Metric(
    "warp_p95_ms", "Main thread per turned picture p95", "ms", 2, "low", _plain(lambda f: f.warp_times.p95)
)
CONTENT_AGE_MEAN = Metric(
    "content_age_mean_ms", "Mean content age", "ms", 0, "low", _plain(lambda f: f.content_ages.mean)
)
CONTENT_AGE_P50 = Metric("content_age_p50_ms", "Content age p50", "ms", 0, "low", _plain(lambda f: f.content_ages.p50))
CONTENT_AGE_P95 = Metric("content_age_p95_ms", "Content age p95", "ms", 0, "low", _plain(lambda f: f.content_ages.p95))

FIRST_PICTURE = Metric(
    "first_picture_s", "First picture of the download", "s", 1, "low", _of_download(lambda d: d.first_picture_ms)
)
WHOLE_SCENE = Metric(
    "whole_scene_s", "All of the download on the screen", "s", 1, "low", _of_download(lambda d: d.complete_ms)
)

METRICS = (
    VIEW_LATENCY_P50,
    VIEW_LATENCY_P90,
    VIEW_LATENCY_P95,
    VIEW_LATENCY_P99,
    PHOTON_P50,
    PHOTON_P90,
    PHOTON_P95,
    PHOTON_P99,
    IN_TIME,
    IN_TIME_FRAME_LESS,
    IN_TIME_FRAME_MORE,
    Metric("inputs", "Inputs", "", 0, None, _plain(lambda f: f.latencies.inputs)),
    Metric("inputs_missed", "Inputs missed by the page", "", 0, "low", _plain(lambda f: f.latencies.missed)),
    Metric("inputs_unanswered", "Unanswered inputs", "", 0, "low", _plain(lambda f: f.latencies.unanswered)),
    CONTENT_AGE_MEAN,
    CONTENT_AGE_P50,
    CONTENT_AGE_P95,
    FRAME_AGE_MEAN,
    FRAME_AGE_P50,
    FRAME_AGE_P95,
    RESPONSE_TIME_MEAN,
    RESPONSE_TIME_P50,
    RESPONSE_TIME_P95,
    RENDER_MEAN,
    RENDER_P50,
    Metric("requests_sent", "Requests", "", 0, None, _requests(lambda r: r.sent)),
    Metric("requests_shown", "Requests shown", "", 0, None, _requests(lambda r: r.shown)),
    Metric("requests_overtaken", "Requests overtaken", "", 0, "low", _requests(lambda r: r.overtaken)),
    Metric("requests_cancelled", "Requests cancelled", "", 0, "low", _requests(lambda r: r.cancelled)),
    Metric("requests_dropped", "Requests dropped", "", 0, "low", _requests(lambda r: r.dropped)),
    Metric("requests_unanswered", "Requests unanswered", "", 0, "low", _requests(lambda r: r.unanswered)),
    NEW_VIEWS,
    Metric("frames_per_s", "Frames", "/s", 1, None, _plain(lambda f: f.frames.per_s)),
    FREEZES,
    FROZEN,
    HEIGHT,
    MEDIAN_HEIGHT,
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
    SEEN_SSIM,
    SEEN_PSNR,
    SEEN_LPIPS,
    UNCOVERED,
    FILLED,
    WARP_MEAN,
    WARP_P95,
    FIRST_PICTURE,
    WHOLE_SCENE,
)
TABLE = (
    VIEW_LATENCY_P95,
    PHOTON_P50,
    PHOTON_P95,
    IN_TIME,
    FRAME_AGE_MEAN,
    FRAME_AGE_P95,
    NEW_VIEWS,
    HEIGHT,
    PROFILE,
    SWITCHES,
    RECEIVED,
    SEEN_SSIM,
)
"""Those that a page has room for."""
