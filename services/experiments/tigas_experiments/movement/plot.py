"""Draws a movement: the way from above, the angles over time, and how fast it turns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from tigas_experiments.movement.summary import Pace
from tigas_experiments.movement.trace import MovementTrace

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
"""Okabe and Ito's palette for colour blindness."""
MOST = 5000
"""Maximum number of drawn poses."""


def plot_movement(trace: MovementTrace, title: str, path: Path) -> None:
    """Write a picture; its kind follows the suffix, such as .png or .svg. Raises OSError, and ValueError for others."""
    times = np.linspace(0, trace.duration_ms, min(MOST, len(trace.times_ms)))
    positions, quaternions = trace.poses_at(times)
    matrix = Rotation.from_quat(quaternions).as_matrix()
    # R = Ry(yaw) · Rx(pitch) · Rz(roll)
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
    pace = Pace.of(trace)
    panels["turning"].stairs(pace.turning, pace.times_s, baseline=None, color=BLUE, linewidth=1)
    panels["turning"].set(xlabel="s", ylabel="degrees a second")
    for panel in panels.values():
        panel.grid(alpha=0.25)
    figure.savefig(path, dpi=130)
