"""Statistics of a movement, and a plot: duration, sampling rate, distance and speed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.table import Floats
from tigas_experiments.movement.trace import MovementTrace

INTERVAL_MS = 100.0
"""Interval over which distance and speed are measured, long enough to exclude the noise of single poses."""
PERCENTILES = (50, 90, 95, 99, 100)
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
"""Okabe and Ito's colour-blind palette."""
MAX_DRAWN_POSES = 5000
"""Maximum number of poses to draw."""


class Pace(NamedTuple):
    """Speeds over time, between poses about `INTERVAL_MS` apart."""

    times_s: Floats
    """[M + 1]"""
    moved: Floats
    """[M], in the trace's unit, per interval."""
    turning: Floats
    """[M], in degrees per second."""

    @classmethod
    def from_trace(cls, trace: MovementTrace) -> Pace:
        count = max(1, round(trace.duration_ms / INTERVAL_MS))
        times = np.linspace(0, trace.duration_ms, count + 1)
        positions, quaternions = trace.poses_at(times)
        rotations = Rotation.from_quat(quaternions)
        angles = np.degrees((rotations[:-1].inv() * rotations[1:]).magnitude())
        seconds = trace.duration_ms / count / 1000
        turning = angles / seconds if seconds else np.zeros(count)
        return cls(times / 1000, np.linalg.norm(np.diff(positions, axis=0), axis=1), turning)


class Summary(NamedTuple):
    poses: int
    duration_s: float
    median_rate_hz: float
    """Median sampling rate; 0 for a single pose."""
    longest_step_ms: float
    path: float
    """Path length in the trace's unit."""
    speed: float
    """Mean speed, in the trace's unit per second."""
    turning: Mapping[int, float]
    """Turning speed in degrees per second, by percentile over time."""

    @classmethod
    def from_trace(cls, trace: MovementTrace) -> Summary:
        pace, seconds = Pace.from_trace(trace), trace.duration_ms / 1000
        steps = np.diff(trace.times_ms)
        path = float(pace.moved.sum())
        return cls(
            poses=len(trace.times_ms),
            duration_s=seconds,
            median_rate_hz=float(1000 / np.median(steps)) if len(steps) else 0.0,
            longest_step_ms=float(steps.max(initial=0)),
            path=path,
            speed=path / seconds if seconds else 0.0,
            turning={percent: float(np.percentile(pace.turning, percent)) for percent in PERCENTILES},
        )


def plot_movement(trace: MovementTrace, title: str, path: Path) -> None:
    """Draw the path from above, the angles over time and the turning speed, in the format of the path's suffix.

    Raises OSError, and ValueError for unknown formats.
    """
    from matplotlib.figure import Figure  # heavy

    times = np.linspace(0, trace.duration_ms, min(MAX_DRAWN_POSES, len(trace.times_ms)))
    positions, quaternions = trace.poses_at(times)
    matrix = Rotation.from_quat(quaternions).as_matrix()
    # R = Ry(yaw) · Rx(pitch) · Rz(roll); as_euler would warn about a camera that looks straight down
    angles = {
        "to the right": np.unwrap(np.arctan2(matrix[:, 0, 2], matrix[:, 2, 2])),
        "up": np.arcsin(np.clip(-matrix[:, 1, 2], -1, 1)),
        "clockwise": np.arctan2(matrix[:, 1, 0], matrix[:, 1, 1]),
    }
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    panels = figure.subplot_mosaic([["way", "angles"], ["way", "turning"]], width_ratios=(2, 3))
    way = panels["way"]
    way.plot(positions[:, 0], positions[:, 2], color=BLUE, linewidth=1)
    way.plot(positions[0, 0], positions[0, 2], "o", color=ORANGE, label="begins")
    unit = "m" if trace.unit == "m" else "the scene's unit"
    way.set(title=title, xlabel=f"x, {unit}", ylabel=f"z, {unit}", aspect="equal", adjustable="datalim")
    way.legend(frameon=False)
    for (label, values), colour in zip(angles.items(), (BLUE, ORANGE, GREEN), strict=True):
        panels["angles"].plot(times / 1000, np.degrees(values), color=colour, linewidth=1, label=label)
    panels["angles"].set_ylabel("degrees")
    panels["angles"].legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    pace = Pace.from_trace(trace)
    panels["turning"].stairs(pace.turning, pace.times_s, baseline=None, color=BLUE, linewidth=1)
    panels["turning"].set(xlabel="s", ylabel="degrees a second")
    for panel in panels.values():
        panel.grid(alpha=0.25)
    figure.savefig(path, dpi=130)
