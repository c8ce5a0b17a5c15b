"""The metrics of a run: one table that defines the columns of CSV files, tables and plots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.wire.figures import INTERACTIVE_MS, USUAL_INTERVAL_MS

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
    """One metric; inf means that too many inputs were never answered for the statistic to exist."""

    name: str
    """Column name in the CSV files, including the unit."""
    title: str
    unit: str
    digits: int
    better: Literal["low", "high"] | None
    at_frames: bool = False
    """Whether values are times of display frames."""

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


def _times(name: str, title: str, *statistics: str, digits: int = 0, at_frames: bool = False) -> tuple[Metric, ...]:
    """Mean and percentiles of one kind of time."""
    return tuple(
        Metric(
            f"{name}_{statistic}_ms",
            f"Mean {title[0].lower()}{title[1:]}" if statistic == "mean" else f"{title} {statistic}",
            "ms",
            digits,
            "low",
            at_frames=at_frames and statistic != "mean",
        )
        for statistic in statistics
    )


_PERCENTILES = ("p50", "p90", "p95", "p99")
_TABLE = (
    *_times("view_latency", "View latency", *_PERCENTILES, at_frames=True),
    *_times("motion_to_photon", "Motion-to-photon", *_PERCENTILES, at_frames=True),
    Metric(IN_TIME, f"Inputs within {INTERACTIVE_MS:g} ms", "%", 1, "high"),
    Metric("inputs_within_a_frame_less_pct", "Inputs within a frame less", "%", 1, "high"),
    Metric("inputs_within_a_frame_more_pct", "Inputs within a frame more", "%", 1, "high"),
    Metric("inputs", "Inputs", "", 0, None),
    Metric("inputs_missed", "Inputs missed by the page", "", 0, "low"),
    Metric("inputs_unanswered", "Unanswered inputs", "", 0, "low"),
    *_times("content_age", "Content age", "mean", "p50", "p95", at_frames=True),
    *_times("frame_age", "Frame age", "mean", "p50", "p95", at_frames=True),
    *(Metric(f"age_{part}_ms", title, "ms", 1, "low") for part, title in PART_TITLES.items()),
    *_times("response_time", "Response time", "mean", "p50", "p95"),
    *_times("render", "Rendering time", "mean", "p50", digits=1),
    Metric("requests_sent", "Requests", "", 0, None),
    Metric("requests_shown", "Requests shown", "", 0, None),
    Metric("requests_overtaken", "Requests overtaken", "", 0, "low"),
    Metric("requests_cancelled", "Requests cancelled", "", 0, "low"),
    Metric("requests_dropped", "Requests dropped", "", 0, "low"),
    Metric("requests_unanswered", "Requests unanswered", "", 0, "low"),
    Metric("new_views_per_s", "New views", "/s", 1, "high"),
    Metric("frames_per_s", "Frames", "/s", 1, None),
    Metric("freezes_per_min", "Freezes", "/min", 1, "low"),
    Metric("frozen_s", "Frozen", "s", 1, "low"),
    Metric("mean_height_px", "Mean height", "px", 0, "high"),
    Metric("median_height_px", "Median height", "px", 0, "high"),
    Metric("mean_profile", "Mean profile (0 is best)", "", 2, "low"),
    Metric("profile_changes_per_min", "Profile changes", "/min", 1, "low"),
    Metric("received_mbit_s", "Received", "Mbit/s", 1, None),
    Metric("over_link_mbit_s", "Over the link", "Mbit/s", 1, None),
    Metric("link_mbit_s", "Link rate", "Mbit/s", 1, None),
    Metric("trace_began_s", "Start position in the trace", "s", 1, None),
    Metric("lost_packets", "Lost packets", "", 0, None),
    Metric("picture_ssim", "SSIM of the picture", "", 3, "high"),
    Metric("picture_psnr_db", "PSNR of the picture", "dB", 1, "high"),
    Metric("view_ssim", "SSIM of the view", "", 3, "high"),
    Metric("view_psnr_db", "PSNR of the view", "dB", 1, "high"),
    Metric("seen_ssim", "SSIM at display time", "", 3, "high"),
    Metric("seen_psnr_db", "PSNR at display time", "dB", 1, "high"),
    Metric("seen_lpips", "LPIPS at display time", "", 3, "low"),
    Metric("border_never_seen_pct", "Border never covered", "%", 1, "low"),
    Metric("border_filled_pct", "Border outside the newest frame", "%", 1, "low"),
    *_times("warp", "Main thread per reprojected picture", "mean", "p95", digits=2),
    Metric("first_picture_s", "First picture of the download", "s", 1, "low"),
    Metric("whole_scene_s", "Complete download on the screen", "s", 1, "low"),
)
METRICS = {metric.name: metric for metric in _TABLE}
"""All metrics by column name."""


def select_metrics(*names: str) -> tuple[Metric, ...]:
    return tuple(METRICS[name] for name in names)


TABLE = select_metrics(
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
"""The most important metrics, for tables on the page."""
