"""Statistics of a movement: duration, density, distance and speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.table import Floats
from tigas_experiments.movement.trace import MovementTrace

INTERVAL_MS = 100.0
"""Way and speeds are measured over about a tenth of a second, so that the noise of single poses is not counted."""
PERCENTILES = (50, 90, 95, 99, 100)


@dataclass(frozen=True, slots=True)
class Pace:
    """Speeds over time, between poses about `INTERVAL_MS` apart."""

    times_s: Floats
    """[M + 1]"""
    moved: Floats
    """[M], in the trace's unit, per interval."""
    turning: Floats
    """[M], degrees a second."""

    @classmethod
    def of(cls, trace: MovementTrace) -> Pace:
        """A trace's."""
        count = max(1, round(trace.duration_ms / INTERVAL_MS))
        times = np.linspace(0, trace.duration_ms, count + 1)
        positions, quaternions = trace.poses_at(times)
        rotations = Rotation.from_quat(quaternions)
        angles = np.degrees((rotations[:-1].inv() * rotations[1:]).magnitude())
        seconds = trace.duration_ms / count / 1000
        turning = angles / seconds if seconds else np.zeros(count)
        return cls(times / 1000, np.linalg.norm(np.diff(positions, axis=0), axis=1), turning)


@dataclass(frozen=True, slots=True)
class Summary:
    """A trace's figures."""

    poses: int
    duration_s: float
    median_rate_hz: float
    """Median rate of the steps between poses; 0 with one pose."""
    longest_step_ms: float
    path: float
    """Path length in the trace's unit."""
    speed: float
    """Mean, in the trace's unit a second."""
    turning: Mapping[int, float]
    """Percentile over time: degrees a second."""

    @classmethod
    def of(cls, trace: MovementTrace) -> Summary:
        """A trace's."""
        pace, seconds = Pace.of(trace), trace.duration_ms / 1000
        steps = np.diff(trace.times_ms)
        path = float(pace.moved.sum())
        return cls(
            poses=len(trace.times_ms),
            duration_s=seconds,
            median_rate_hz=float(1000 / np.median(steps)) if len(steps) else 0.0,
            longest_step_ms=float(steps.max()) if len(steps) else 0.0,
            path=path,
            speed=path / seconds if seconds else 0.0,
            turning={percent: float(np.percentile(pace.turning, percent)) for percent in PERCENTILES},
        )
