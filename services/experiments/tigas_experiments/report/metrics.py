"""The figures of a run: one table that defines the columns of CSV files, tables and plots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from tigas_experiments.wire.figures import INTERACTIVE_MS, USUAL_INTERVAL_MS, Figures
from tigas_experiments.wire.recording import RecordingHead

Value = float | None
NEVER = "never"
NONE = "–"
PART_TITLES = {
    "wait": "Wait for a request",
    "queue": "Server queue",
    "render": "Rendering",
    "encode": "Encoding",
    "network": "Network",
    "enhance": "Enhancement",
    "page": "Page and display",
}
"""Parts of the frame age (`statistics.age_parts`)."""


@dataclass(frozen=True, slots=True)
class Metric:
    """One figure; inf means that too many inputs were never answered for the statistic to exist."""

    name: str
    """Column name in the CSV files, including the unit."""
    title: str
    unit: str
    digits: int
    better: Literal["low", "high"] | None
    source: str = ""
    """Attribute path below `Figures`; empty for a figure that `values_of` computes."""
    scale: float = 1.0
    at_frames: bool = False
    """Whether values are times of display frames."""

    def of(self, figures: Figures) -> Value:
        """Value at the source; None if it was not measured."""
        found: Any = figures
        for name in self.source.split("."):
            parent, found = found, getattr(found, name)
            if found is None:
                return math.inf if getattr(parent, "unanswered", 0) else None
        return float(found) * self.scale

    @property
    def step(self) -> float:
        """Smallest observable difference: one frame of a common display, or the last printed digit."""
        return USUAL_INTERVAL_MS if self.at_frames else 10.0**-self.digits

    @property
    def heading(self) -> str:
        return f"{self.title}, {self.unit}" if self.unit else self.title

    def text(self, value: Value) -> str:
        if value is None:
            return NONE
        return NEVER if math.isinf(value) else f"{value:,.{self.digits}f}"


def values_of(head: RecordingHead, figures: Figures, age_parts: Mapping[str, float]) -> dict[str, Value]:
    minutes = head.duration_ms / 60_000
    computed: dict[str, Value] = {f"age_{part}_ms": ms for part, ms in age_parts.items()}
    computed["freezes_per_min"] = figures.freezes.count / minutes
    if figures.rungs.share:
        computed["profile_changes_per_min"] = figures.rungs.switches / minutes
    if (local := head.local) is not None:
        for name, ms in (("first_picture_s", local.first_picture_ms), ("whole_scene_s", local.complete_ms)):
            computed[name] = math.inf if ms is None else (local.began_ms + ms) / 1000
    return {name: metric.of(figures) if metric.source else computed.get(name) for name, metric in METRICS.items()}


def _times(
    name: str, title: str, source: str, *statistics: str, digits: int = 0, at_frames: bool = False
) -> tuple[Metric, ...]:
    """Mean and percentiles of one kind of time."""
    return tuple(
        Metric(
            f"{name}_{statistic}_ms",
            f"Mean {title[0].lower()}{title[1:]}" if statistic == "mean" else f"{title} {statistic}",
            "ms",
            digits,
            "low",
            f"{source}.{statistic}",
            at_frames=at_frames and statistic != "mean",
        )
        for statistic in statistics
    )


_PERCENTILES = ("p50", "p90", "p95", "p99")
IN_TIME = f"inputs_within_{INTERACTIVE_MS:g}ms_pct"
_WITHIN = (
    (IN_TIME, f"{INTERACTIVE_MS:g} ms", "share_interactive"),
    ("inputs_within_a_frame_less_pct", "a frame less", "share_frame_less"),
    ("inputs_within_a_frame_more_pct", "a frame more", "share_frame_more"),
)
_TABLE = (
    *_times("view_latency", "View latency", "view_latencies", *_PERCENTILES, at_frames=True),
    *_times("motion_to_photon", "Motion-to-photon", "latencies", *_PERCENTILES, at_frames=True),
    *(Metric(name, f"Inputs within {of}", "%", 1, "high", f"latencies.{share}", 100) for name, of, share in _WITHIN),
    Metric("inputs", "Inputs", "", 0, None, "latencies.inputs"),
    Metric("inputs_missed", "Inputs missed by the page", "", 0, "low", "latencies.missed"),
    Metric("inputs_unanswered", "Unanswered inputs", "", 0, "low", "latencies.unanswered"),
    *_times("content_age", "Content age", "content_ages", "mean", "p50", "p95", at_frames=True),
    *_times("frame_age", "Frame age", "frame_ages", "mean", "p50", "p95", at_frames=True),
    *(Metric(f"age_{part}_ms", title, "ms", 1, "low") for part, title in PART_TITLES.items()),
    *_times("response_time", "Response time", "response_times", "mean", "p50", "p95"),
    *_times("render", "Rendering time", "render_times", "mean", "p50", digits=1),
    Metric("requests_sent", "Requests", "", 0, None, "requests.sent"),
    Metric("requests_shown", "Requests shown", "", 0, None, "requests.shown"),
    Metric("requests_overtaken", "Requests overtaken", "", 0, "low", "requests.overtaken"),
    Metric("requests_cancelled", "Requests cancelled", "", 0, "low", "requests.cancelled"),
    Metric("requests_dropped", "Requests dropped", "", 0, "low", "requests.dropped"),
    Metric("requests_unanswered", "Requests unanswered", "", 0, "low", "requests.unanswered"),
    Metric("new_views_per_s", "New views", "/s", 1, "high", "frames.new_views_per_s"),
    Metric("frames_per_s", "Frames", "/s", 1, None, "frames.per_s"),
    Metric("freezes_per_min", "Freezes", "/min", 1, "low"),
    Metric("frozen_s", "Frozen", "s", 1, "low", "freezes.total_ms", 1e-3),
    Metric("mean_height_px", "Mean height", "px", 0, "high", "mean_height"),
    Metric("median_height_px", "Median height", "px", 0, "high", "median_height"),
    Metric("mean_profile", "Mean profile (0 is best)", "", 2, "low", "rungs.mean"),
    Metric("profile_changes_per_min", "Profile changes", "/min", 1, "low"),
    Metric("received_mbit_s", "Received", "Mbit/s", 1, None, "received_kbps", 1e-3),
    Metric("over_link_mbit_s", "Over the link", "Mbit/s", 1, None, "delivered_kbps", 1e-3),
    Metric("link_mbit_s", "Link rate", "Mbit/s", 1, None, "target_kbps", 1e-3),
    Metric("trace_began_s", "Start position in the trace", "s", 1, None, "trace_start_ms", 1e-3),
    Metric("lost_packets", "Lost packets", "", 0, None, "drops"),
    Metric("picture_ssim", "SSIM of the picture", "", 3, "high", "quality.picture_ssim"),
    Metric("picture_psnr_db", "PSNR of the picture", "dB", 1, "high", "quality.picture_psnr_db"),
    Metric("view_ssim", "SSIM of the view", "", 3, "high", "quality.view_ssim"),
    Metric("view_psnr_db", "PSNR of the view", "dB", 1, "high", "quality.view_psnr_db"),
    Metric("seen_ssim", "SSIM at display time", "", 3, "high", "quality.seen_ssim"),
    Metric("seen_psnr_db", "PSNR at display time", "dB", 1, "high", "quality.seen_psnr_db"),
    Metric("seen_lpips", "LPIPS at display time", "", 3, "low", "quality.seen_lpips"),
    Metric("border_never_seen_pct", "Border never covered", "%", 1, "low", "quality.uncovered", 100),
    Metric("border_filled_pct", "Border outside the newest frame", "%", 1, "low", "filled", 100),
    *_times("warp", "Main thread per reprojected picture", "warp_times", "mean", "p95", digits=2),
    Metric("first_picture_s", "First picture of the download", "s", 1, "low"),
    Metric("whole_scene_s", "Complete download on the screen", "s", 1, "low"),
)
METRICS = {metric.name: metric for metric in _TABLE}
"""Every figure by its column name."""


def chosen(*names: str) -> tuple[Metric, ...]:
    return tuple(METRICS[name] for name in names)


TABLE = chosen(
    "view_latency_p95_ms",
    "motion_to_photon_p50_ms",
    "motion_to_photon_p95_ms",
    IN_TIME,
    "frame_age_mean_ms",
    "frame_age_p95_ms",
    "new_views_per_s",
    "mean_height_px",
    "mean_profile",
    "profile_changes_per_min",
    "received_mbit_s",
    "seen_ssim",
)
"""The most important figures, for tables on the page."""
