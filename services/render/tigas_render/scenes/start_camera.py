"""A start camera for a scene that names none: where a visitor sees most of what was captured.

An object is looked at from outside, a little from above; in a capture that surrounds the viewer, such as a room, the
viewer stands inside. Of several places around, the one from which most Gaussians can be seen is taken, as captures have
the most Gaussians where there is the most to see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from tigas_common.wire.model import Point
from tigas_common.wire.render import StartCamera

SAMPLE = 10_000
"""Gaussians that are looked at, spread evenly over the file; from 32,768 numbers on, PyTorch starts threads."""
SOLID = 0.5
"""Opacity from which on a Gaussian hides what is behind it."""
AZIMUTHS = 16
TAN_Y, TAN_X = math.tan(math.radians(30)), math.tan(math.radians(40))
"""Half the vertical field of view, 60°, and half of a horizontal one that any screen but a phone held upright has."""
MARGIN = 1.12
ELEVATION = math.radians(12)
FAR, ROOM = 1.5, 4.0
"""A capture with outliers so many times as far as its middle 80 %, or half as many metres across, may be a place."""
FRONT_BIAS = 0.12
"""How much a view along +z is preferred: where capturing tools put the front, and azimuth 0 of the protocol."""


def derive_camera(means: torch.Tensor, opacities: torch.Tensor, scales: torch.Tensor, up: Point) -> StartCamera:
    """Where to start in a scene of means [N, 3], opacities [N] and scales [N, 3] (standard deviations).

    `up` points up in the scene; it need not have length one.
    """
    points, radii = _sample(means, opacities, scales)
    frame = _level_frame(up).to(points)
    points = points @ frame.T  # [S, 3]: right, down, forward
    low, high = torch.quantile(points, points.new_tensor([0.015, 0.985]), dim=0)
    centre, half = (low + high) / 2, (high - low) / 2
    size = max(float(half.norm()), 3 * float(radii.median()), 1e-3 * float(centre.norm()), 1e-6)
    stand = _place_inside(points)
    if stand is None:
        position, target = _outside(points, centre, half, size)
    else:
        position, target = stand, _widest_view(points, stand)
    return StartCamera(position=_point(position @ frame), look_at=_point(target @ frame))


def _sample(means: torch.Tensor, opacities: torch.Tensor, scales: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Up to SAMPLE solid Gaussians' centres [S, 3] and radii [S], in double precision on the CPU."""
    step = max(1, len(means) // SAMPLE)
    means, opacities, scales = means[::step].cpu(), opacities[::step].cpu(), scales[::step].cpu()
    solid = opacities >= min(SOLID, float(opacities.max()))
    # the protocol's coordinates end at 1e9, and the camera stands outside
    return means[solid].double().clamp(-1e8, 1e8), scales[solid].double().amax(1).clamp(max=1e8)


def _level_frame(up: Point) -> torch.Tensor:
    """[3, 3] rows: right, down and forward, with forward as near to +z as a level direction can be."""
    down = -torch.tensor(up, dtype=torch.float64)
    down = down / down.norm()
    ahead = torch.tensor([0.0, 0.0, 1.0] if abs(down[2]) < 0.9 else [0.0, 1.0, 0.0], dtype=torch.float64)
    forward = ahead - down * (ahead @ down)
    forward = forward / forward.norm()
    return torch.stack((torch.linalg.cross(down, forward), down, forward))


def _outside(
    points: torch.Tensor, centre: torch.Tensor, half: torch.Tensor, size: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """A place from which the whole object fits into the picture, on the side where most of it can be seen."""
    reach = float(half[[0, 2]].max())
    distance = MARGIN * max(float(half[1]) / TAN_Y, reach / TAN_X, size / 4) + reach
    best, best_score = centre, -1.0
    for k in range(AZIMUTHS):
        azimuth = 2 * math.pi * k / AZIMUTHS
        back = points.new_tensor(
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


def _place_inside(points: torch.Tensor) -> torch.Tensor | None:
    """Where to stand in a capture that surrounds the viewer; None if it is none.

    Nearly everywhere in the middle of such a capture, something is seen in every direction above the horizon. That is
    true of the hollow inside of an object as well, but an object neither has the far outliers of a room or a landscape
    (seen through windows, or as background) nor a room's size in metres.
    """
    low, high, far_low, far_high = torch.quantile(points, points.new_tensor([0.1, 0.9, 0.005, 0.995]), dim=0)
    centre, half = (low + high) / 2, (high - low) / 2
    size = float(half.norm())
    if size == 0 or (float((far_high - far_low).norm()) / 2 < FAR * size and size < ROOM):
        return None
    steps = (-0.5, -0.25, 0.0, 0.25, 0.5)
    places: list[torch.Tensor] = [centre + half * points.new_tensor([x, 0.0, z]) for z in steps for x in steps]
    views = [_seen(points, place) for place in places]
    if sorted(view.enclosure for view in views)[len(views) // 2] < 0.95:
        return None
    best = max(range(len(places)), key=lambda i: round(min(views[i].clearance / size, 0.3), 2))
    return places[best]


def _widest_view(points: torch.Tensor, stand: torch.Tensor) -> torch.Tensor:
    """What to look at from inside: the direction in which most is seen, at eye level."""
    to = points - stand
    azimuth = torch.atan2(to[:, 0], to[:, 2])
    level = to[:, 1].abs() < TAN_Y * to[:, [0, 2]].norm(dim=1)
    best, best_score = 0.0, -1.0
    for k in range(AZIMUTHS):
        turn = 2 * math.pi * k / AZIMUTHS
        ahead = torch.cos(azimuth - turn) > math.cos(math.radians(42))
        far = to[ahead & level][:, [0, 2]].norm(dim=1).sum()
        score = float(far) * (1 + FRONT_BIAS * math.cos(turn))
        if score > best_score + 1e-9:
            best, best_score = turn, score
    ahead_of: torch.Tensor = points.new_tensor([math.sin(best), 0.0, math.cos(best)])
    target: torch.Tensor = stand + to.norm(dim=1).median() * ahead_of
    return target


@dataclass(frozen=True, slots=True)
class _View:
    """What a panorama shows; all but `clearance` are fractions."""

    seen: float
    """Of the points: not hidden behind others."""
    enclosure: float
    """Of the directions from the horizon to 30° above it: not empty."""
    clearance: float
    """Distance to the nearest points."""


def _seen(points: torch.Tensor, position: torch.Tensor) -> _View:
    """A panorama of 96 × 48 directions from `position`, with a depth buffer."""
    columns, rows = 96, 48
    to = points - position
    distance = to.norm(dim=1).clamp_min(1e-12)
    column = ((torch.atan2(to[:, 0], to[:, 2]) / (2 * math.pi) + 0.5) * columns).long().clamp(0, columns - 1)
    row = ((torch.asin((to[:, 1] / distance).clamp(-1, 1)) / math.pi + 0.5) * rows).long().clamp(0, rows - 1)
    cell = row * columns + column
    nearest = torch.full((rows * columns,), math.inf, dtype=distance.dtype)
    nearest.scatter_reduce_(0, cell, distance, "amin")
    # a cell is wider than most Gaussians, so what lies a little behind its nearest one is next to it
    seen = float((distance <= 1.05 * nearest[cell]).double().mean())
    covered = nearest.isfinite().view(rows, columns)
    # pooled to 24 columns: captures are sparse far away
    above = covered[rows // 2 - 8 : rows // 2].view(2, 4, 24, 4).any(3).any(1)
    k = min(len(points), max(1, len(points) // 500))
    return _View(seen, float(above.double().mean()), float(distance.kthvalue(k).values))


def _point(vector: torch.Tensor) -> Point:
    x, y, z = (float(value) for value in vector)
    return (x, y, z)
