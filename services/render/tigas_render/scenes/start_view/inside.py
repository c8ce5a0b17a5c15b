"""The start view from inside a capture: the place and direction with the most to see."""

from __future__ import annotations

import numpy as np

from tigas_render.scenes.start_view.grid import Flags, Grid, Hits
from tigas_render.scenes.start_view.places import Places, median_distance, rays, trace_all
from tigas_render.scenes.start_view.surfels import Doubles

MAX_PLACES = 100
AZIMUTHS = 48
WINDOW = 11
"""Number of azimuths in view, which are 82°."""
ELEVATIONS = tuple(range(-40, 33, 6))
PITCH = -4.0
"""Pitch of the view in degrees."""
LEVEL = ELEVATIONS.index(2)
CENTRE = (ELEVATIONS.index(-10), ELEVATIONS.index(2) + 1)
"""Rows around the middle of the image."""
TOO_NEAR = 0.35
"""Distance in eye heights below which a surface in the middle of the image is in the way: half a metre."""
BLURRED = 0.025
"""Angular size in radians above which a Gaussian looks blurred."""
MAX_DEVIATION = 48.0
"""Standard deviation of the brightness (0 to 255) above which more contrast does not help."""
DARK, BRIGHT = 0.04, 0.97


def best_view(grid: Grid, places: Places, median: Doubles) -> tuple[Doubles, Doubles]:
    """Position and focus, [3] each. median: of the Gaussians' centres, which the view should preferably face."""
    points, penalties = places.points, places.penalties
    if len(points) > MAX_PLACES:  # a selection from all over the capture
        chosen = np.linspace(0, len(points) - 1, MAX_PLACES).round().astype(np.int64)
        points, penalties = points[chosen], penalties[chosen]
    hits = trace_all(grid, points, rays(ELEVATIONS, AZIMUTHS).reshape(-1, 3))
    scores, sights = _scores(grid, points, hits, median, places.eye)
    place, azimuth = np.unravel_index(int(np.argmax((scores - penalties[:, None]).round(9))), scores.shape)
    turn = 2 * np.pi * azimuth / AZIMUTHS
    pitch = np.radians(PITCH)
    ahead = np.array([np.cos(pitch) * np.sin(turn), -np.sin(pitch), np.cos(pitch) * np.cos(turn)])
    return points[place], points[place] + ahead * float(sights[place])


def _scores(grid: Grid, points: Doubles, hits: Hits, median: Doubles, eye: float) -> tuple[Doubles, Doubles]:
    """Score of each place and azimuth [P, A], and the median viewing distance [P] at each place."""
    number, shape = len(points), (len(points), len(ELEVATIONS), AZIMUTHS)
    covered = hits.covered.reshape(shape)
    distances = np.where(np.isfinite(hits.distances), hits.distances, 3 * grid.size).reshape(shape)
    sights = median_distance(hits.distances.reshape(number, -1), 3 * grid.size)
    hit = hits.cells >= 0
    # a cell counts once per place, however many of the place's rays hit it
    ids = np.repeat(np.arange(number), shape[1] * shape[2]) * len(grid.numbers) + hits.cells
    _, inverse, times = np.unique(ids, return_inverse=True, return_counts=True)
    seen = np.where(hit, grid.numbers[hits.cells] / times[inverse], 0).reshape(shape)
    light = np.where(hit, grid.lights[hits.cells], np.nan).reshape(shape)
    blurred = (hit & (np.exp(grid.log_sizes[hits.cells]) > BLURRED * hits.distances)).reshape(shape)
    views = (np.arange(AZIMUTHS)[:, None] + np.arange(WINDOW) - WINDOW // 2) % AZIMUTHS

    def windows(values: Doubles | Flags) -> Doubles:
        """[P, A, E · W] the values in the image for each azimuth."""
        return values[:, :, views].transpose(0, 2, 1, 3).reshape(number, AZIMUTHS, -1).astype(np.float64)

    depths = windows(distances)
    logarithms = np.log((depths / grid.size).clip(1e-3))
    towards = median - points
    facing = np.arctan2(towards[:, 0], towards[:, 2])[:, None] - 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    middle = distances[:, CENTRE[0] : CENTRE[1], :][:, :, views[:, WINDOW // 2 - 1 : WINDOW // 2 + 2]]
    scores = (
        1.3 * np.log(windows(seen).sum(2) + 1)
        + 4 * windows(covered[:, :LEVEL]).mean(2)
        + np.minimum(windows(covered[:, LEVEL:]).mean(2), 0.6)
        - 2.5 * (depths < 0.5 * sights[:, None, None]).mean(2)
        - windows(blurred).mean(2)
        + 0.7 * np.quantile(logarithms, 0.9, axis=2)
        + 0.5 * logarithms.std(2)
        + 0.5 * np.cos(facing)
        + _light_score(windows(light))
        - np.hypot(towards[:, 0], towards[:, 2])[:, None] / grid.size
        - 6.0 * (middle.min((1, 3)) < TOO_NEAR * eye)
    )
    return scores, sights


def _light_score(values: Doubles) -> Doubles:
    """Score [P, A] that favours contrast, and penalises black or blown-out images. values: NaN if nothing was hit."""
    there = np.isfinite(values)
    number = there.sum(2).clip(1)
    filled = np.where(there, values, 0)
    mean = filled.sum(2) / number
    deviation = 255 * np.sqrt((np.where(there, values - mean[:, :, None], 0) ** 2).sum(2) / number)
    lost = ((filled > BRIGHT) | ((filled < DARK) & there)).sum(2) / number
    score: Doubles = 2 * np.log(3 + np.minimum(deviation, MAX_DEVIATION)) - 12 * (lost - 0.02).clip(0)
    return score
