"""A start camera for a scene that names none, chosen to show most of the capture.

An object is seen from outside, slightly from above; in a capture that surrounds the viewer, such as a room, the viewer
stands inside. Of several candidate positions, the one with most Gaussians in view wins, since captures have the most
Gaussians where there is the most to see.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Batches, Floats, Gaussians

Doubles = NDArray[np.float64]

SAMPLE = 10_000
"""Gaussians that are looked at, about, spread evenly over the file."""
SOLID = 0.5
"""Opacity from which on a Gaussian occludes."""
AZIMUTHS = 16
TAN_Y, TAN_X = math.tan(math.radians(30)), math.tan(math.radians(40))
"""Half the vertical field of view, 60°, and half a horizontal one available on any screen but a phone held upright."""
MARGIN = 1.12
ELEVATION = math.radians(12)
FAR, ROOM = 1.5, 4.0
"""A capture with outliers this many times as far as its middle 80 %, or half as many metres across, may be a place."""
FRONT_BIAS = 0.12
"""Bonus for a view along +z: the front in capturing tools, and azimuth 0 of the protocol."""


class SceneStatistics:
    """Statistics of a scene, collected while its Gaussians pass on their way to the rasteriser."""

    def __init__(self) -> None:
        self.count = 0
        """Number of Gaussians that can be drawn."""
        self.low: NDArray[np.float32] = np.full(3, np.inf, np.float32)
        self.high: NDArray[np.float32] = np.full(3, -np.inf, np.float32)
        """Bounds of their centres, [3]."""
        self._some: list[Gaussians] = []

    def collect(self, scene: Batches) -> Batches:
        """The same batches; reading them collects the statistics, which are complete in the end."""
        return Batches(scene.most, self._collected(scene))

    def _collected(self, scene: Batches) -> Iterator[Gaussians]:
        step = max(1, scene.most // SAMPLE)
        for part in scene.parts:
            self.low = np.minimum(self.low, part.means.min(0))
            self.high = np.maximum(self.high, part.means.max(0))
            self._some.append(Gaussians(*(array[-self.count % step :: step].copy() for array in part.arrays)))
            self.count += len(part)
            yield part

    @property
    def sample(self) -> Gaussians:
        """About SAMPLE Gaussians, spread evenly over the file."""
        columns = zip(*(some.arrays for some in self._some), strict=True)
        return Gaussians(*(np.concatenate(parts) for parts in columns))

    def camera(self, up: Point) -> StartCamera:
        """A start camera, as by `derive_camera`."""
        return derive_camera(self.sample, up)


def derive_camera(gaussians: Gaussians, up: Point) -> StartCamera:
    """Start camera of a scene. `up` points up in it, and need not have length one."""
    points, radii = _sample(gaussians.means, gaussians.opacities, gaussians.scales)
    frame = _level_frame(up)
    points = points @ frame.T  # [S, 3]: right, down, forward
    low, high = np.quantile(points, (0.015, 0.985), axis=0)
    centre, half = (low + high) / 2, (high - low) / 2
    size = max(_length(half), 3 * float(np.median(radii)), 1e-3 * _length(centre), 1e-6)
    stand = _place_inside(points)
    if stand is None:
        position, target = _outside(points, centre, half, size)
    else:
        position, target = stand, _widest_view(points, stand)
    return StartCamera(position=_point(position @ frame), look_at=_point(target @ frame))


def _sample(means: Floats, opacities: Floats, scales: Floats) -> tuple[Doubles, Doubles]:
    """Up to SAMPLE solid Gaussians' centres [S, 3] and radii [S], in double precision."""
    step = max(1, len(means) // SAMPLE)
    means, opacities, scales = means[::step], opacities[::step], scales[::step]
    solid = opacities >= min(SOLID, float(opacities.max()))
    # the protocol's coordinates end at 1e9, and the camera stands outside
    return means[solid].astype(np.float64).clip(-1e8, 1e8), scales[solid].astype(np.float64).max(1).clip(max=1e8)


def _level_frame(up: Point) -> Doubles:
    """[3, 3] rows: right, down and forward, with forward as near to +z as a level direction can be."""
    down = -np.array(up, np.float64)
    down /= _length(down)
    ahead = np.array([0.0, 0.0, 1.0] if abs(down[2]) < 0.9 else [0.0, 1.0, 0.0])
    forward = ahead - down * (ahead @ down)
    forward /= _length(forward)
    return np.stack((np.cross(down, forward), down, forward))


def _outside(points: Doubles, centre: Doubles, half: Doubles, size: float) -> tuple[Doubles, Doubles]:
    """A place from which the whole object fits into the picture, on the side where most of it can be seen."""
    reach = float(half[[0, 2]].max())
    distance = MARGIN * max(float(half[1]) / TAN_Y, reach / TAN_X, size / 4) + reach
    best, best_score = centre, -1.0
    for k in range(AZIMUTHS):
        azimuth = 2 * math.pi * k / AZIMUTHS
        back = np.array(
            [
                -math.sin(azimuth) * math.cos(ELEVATION),
                -math.sin(ELEVATION),
                -math.cos(azimuth) * math.cos(ELEVATION),
            ]
        )
        position = centre + distance * back
        score = _seen(points, position).seen * (1 + FRONT_BIAS * math.cos(azimuth))
        if score > best_score + 1e-9:
            best, best_score = position, score
    return best, centre


def _place_inside(points: Doubles) -> Doubles | None:
    """Position in a capture that surrounds the viewer; None for other captures.

    Nearly everywhere in the middle of such a capture, there is something in every direction above the horizon. That is
    also true of the hollow inside of an object, but an object has neither the far outliers of a room or a landscape
    (seen through windows, or as background) nor a room's size in metres.
    """
    low, high, far_low, far_high = np.quantile(points, (0.1, 0.9, 0.005, 0.995), axis=0)
    centre, half = (low + high) / 2, (high - low) / 2
    size = _length(half)
    if size == 0 or (_length(far_high - far_low) / 2 < FAR * size and size < ROOM):
        return None
    steps = (-0.5, -0.25, 0.0, 0.25, 0.5)
    places: list[Doubles] = [centre + half * np.array([x, 0.0, z]) for z in steps for x in steps]
    views = [_seen(points, place) for place in places]
    if sorted(view.enclosure for view in views)[len(views) // 2] < 0.95:
        return None
    best = max(range(len(places)), key=lambda i: round(min(views[i].clearance / size, 0.3), 2))
    return places[best]


def _widest_view(points: Doubles, stand: Doubles) -> Doubles:
    """Focus from inside: the direction with the most Gaussians in view, at eye level."""
    to = points - stand
    azimuth = np.arctan2(to[:, 0], to[:, 2])
    across = np.hypot(to[:, 0], to[:, 2])
    level = np.abs(to[:, 1]) < TAN_Y * across
    best, best_score = 0.0, -1.0
    for k in range(AZIMUTHS):
        turn = 2 * math.pi * k / AZIMUTHS
        ahead = np.cos(azimuth - turn) > math.cos(math.radians(42))
        score = float(across[ahead & level].sum()) * (1 + FRONT_BIAS * math.cos(turn))
        if score > best_score + 1e-9:
            best, best_score = turn, score
    target: Doubles = stand + np.median(_lengths(to)) * np.array([math.sin(best), 0.0, math.cos(best)])
    return target


@dataclass(frozen=True, slots=True)
class _View:
    """Measurements of a panorama; all but `clearance` are fractions."""

    seen: float
    """Of the points: not hidden behind others."""
    enclosure: float
    """Of the directions from the horizon to 30° above it: not empty."""
    clearance: float
    """Distance to the nearest points."""


def _seen(points: Doubles, position: Doubles) -> _View:
    """A panorama of 96 × 48 directions from `position`, with a depth buffer."""
    columns, rows = 96, 48
    to = points - position
    distance = _lengths(to).clip(min=1e-12)
    column = ((np.arctan2(to[:, 0], to[:, 2]) / (2 * math.pi) + 0.5) * columns).astype(np.int64).clip(0, columns - 1)
    row = ((np.arcsin((to[:, 1] / distance).clip(-1, 1)) / math.pi + 0.5) * rows).astype(np.int64).clip(0, rows - 1)
    cell = row * columns + column
    nearest = np.full(rows * columns, math.inf)
    np.minimum.at(nearest, cell, distance)
    # a cell is wider than most Gaussians, so those slightly behind its nearest one are next to it
    seen = float(np.mean(distance <= 1.05 * nearest[cell]))
    covered = np.isfinite(nearest).reshape(rows, columns)
    # pooled to 24 columns: captures are sparse far away
    above = covered[rows // 2 - 8 : rows // 2].reshape(2, 4, 24, 4).any((1, 3))
    k = min(len(points), max(1, len(points) // 500))
    return _View(seen, float(above.mean()), float(np.partition(distance, k - 1)[k - 1]))


def _length(vector: Doubles) -> float:
    return float(np.linalg.norm(vector))


def _lengths(vectors: Doubles) -> Doubles:
    lengths: Doubles = np.linalg.norm(vectors, axis=1)
    return lengths


def _point(vector: Doubles) -> Point:
    x, y, z = (float(value) for value in vector)
    return (x, y, z)
