"""The up axis of a scene, from the normals and the layers of its Gaussians.

Floors, tables and ceilings have vertical normals, and most objects stand in one thin layer above the ground. Both are
measured along many axes. They do not determine the sign, and free-standing objects show neither, so the file's own axes
count as well: captures more often have y down than z up, and z up than y up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tigas_render.scenes.start_view.surfels import Doubles, Surfels

SAMPLE, SLAB_SAMPLE = 12_000, 6_000
"""Number of Gaussians in the samples for normals and for layers."""
DIRECTIONS = 1_000
PEAKS, PEAK_DISTANCE = 9, math.cos(math.radians(13))
CAP = math.cos(math.radians(8))
"""Cosine of 8°, the largest angle between an axis and its normals."""
REFINEMENTS = tuple(math.cos(math.radians(angle)) for angle in (14, 10, 7, 7))
CLIMBS = tuple(math.radians(angle) for angle in (4, 2, 1, 0.5))
SLAB = 0.08
"""Thickness of a layer, as a multiple of the median distance from the median."""
DOWN_Y, UP_Z = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
TILTED_SLAB, LYING_SLAB = 0.15, 0.3
"""Shares in the densest layer above which an object is tilted in its file, or its file has z up."""
FILE_AXES = ((DOWN_Y, 3.0), (UP_Z, 1.65), (-DOWN_Y, 1.2))
"""Common up axes of files, and their weights."""
NEAR, NOT_FAR = math.cos(math.radians(28)), math.cos(math.radians(40))
SNAP = math.cos(math.radians(3.5))
"""Cosine of the angle within which an axis snaps to one of the file's axes."""


@dataclass(frozen=True, slots=True)
class UpAxis:
    """An up axis, and the evidence for it."""

    up: Doubles
    """[3] unit vector."""
    slab: float
    """Share of the Gaussians, by area or by number, in the densest layer perpendicular to it."""


def likely_axes(found: Surfels) -> list[UpAxis]:
    """Possible up axes, the most likely first. The result is deterministic."""
    evidence = _AxisEvidence(found.subsample(SAMPLE))
    scored: list[tuple[float, UpAxis]] = []
    for axis in _distinct([*evidence.candidates(), *np.eye(3)]):
        upright, slab = evidence.upright_score(axis)
        for up in (axis, -axis):
            scored.append((upright + evidence.sign_score(up) + _prior(up), UpAxis(_snap_to_file_axis(up), slab)))
    return [axis for _, axis in sorted(scored, key=lambda each: -each[0])]


def object_axis(likely: list[UpAxis]) -> Doubles:
    """The up axis of an object without surroundings: a likely axis near one of the file's, if a dense layer supports
    it, or the file's usual one. The flat sides of an object need not be level.
    """
    for axis in likely:
        if axis.up @ DOWN_Y > NEAR and axis.slab > TILTED_SLAB:
            return axis.up
        if axis.up @ UP_Z > NEAR and axis.slab > LYING_SLAB:
            return axis.up
    return DOWN_Y


class _AxisEvidence:
    """Evidence for the axes of a sample of S Gaussians."""

    def __init__(self, found: Surfels) -> None:
        thin, middle, long = found.extents.T
        area = middle * long
        area = np.minimum(area, np.quantile(area, 0.9))
        flat = 1 - np.divide(thin, middle, out=np.ones_like(thin), where=middle > 0)
        self._normals = found.normals.astype(np.float32)
        self._weights = (found.opacities * area * flat**2).astype(np.float32)
        total = float(self._weights.sum())
        self._weights = self._weights / total if total > 0 else self._weights
        layered = found.subsample(SLAB_SAMPLE)
        median = np.median(layered.centres, axis=0)
        self._points = layered.centres - median
        self._radius = max(float(np.median(np.linalg.norm(self._points, axis=1))), 1e-9)
        self._areas = layered.opacities * np.minimum(layered.extents[:, 1] * layered.extents[:, 2], area.max())
        total = float(self._areas.sum())
        self._areas = self._areas / total if total > 0 else np.full(len(layered), 1 / len(layered))

    def density(self, axes: Doubles) -> Doubles:
        """[A] density of normals around each axis [A, 3], relative to evenly distributed normals."""
        found = np.empty(len(axes))
        for start in range(0, len(axes), 100):
            near = np.abs(axes[start : start + 100].astype(np.float32) @ self._normals.T) > CAP
            found[start : start + 100] = near @ self._weights
        return found / (1 - CAP)

    def peaks(self) -> list[Doubles]:
        """The axes with the most normals, refined."""
        directions = _hemisphere(DIRECTIONS)
        density = self.density(directions)
        peaks: list[Doubles] = []
        for i in np.argsort(-density, kind="stable"):
            if len(peaks) == PEAKS or density[i] == 0:
                break
            if all(abs(float(directions[i] @ peak)) < PEAK_DISTANCE for peak in peaks):
                peaks.append(directions[i])
        return [self._refine(peak) for peak in peaks]

    def _refine(self, axis: Doubles) -> Doubles:
        for cap in REFINEMENTS:
            cosines = self._normals @ axis.astype(np.float32)
            near = np.abs(cosines) > cap
            mean = (self._weights[near] * np.sign(cosines[near])) @ self._normals[near]
            length = float(np.linalg.norm(mean))
            if length == 0:
                return axis
            axis = mean.astype(np.float64) / length
        return axis

    def candidates(self) -> list[Doubles]:
        """The peaks, and local maxima of the evidence near the best peaks and the axis of the densest layer."""
        directions = _hemisphere(DIRECTIONS // 2)
        layered = directions[int(np.argmax(self.slab_shares(directions)))]
        peaks = self.peaks()
        starts = sorted(peaks, key=lambda axis: -self.upright_score(axis)[0])[:3]
        return [*peaks, *(self._climb(axis) for axis in (*starts, layered))]

    def _climb(self, axis: Doubles) -> Doubles:
        for step in CLIMBS:
            right = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            right /= np.linalg.norm(right)
            down = np.cross(axis, right)
            turns = np.arange(8) * math.pi / 4
            around = np.cos(turns)[:, None] * right + np.sin(turns)[:, None] * down
            tried = np.concatenate((axis[None], axis * math.cos(step) + around * math.sin(step)))
            axis = tried[int(np.argmax(self.upright_scores(tried)))]
        return axis

    def slab_shares(self, axes: Doubles) -> Doubles:
        """[A] share of the Gaussians in the densest layer perpendicular to each axis, by number or by area."""
        shares = np.empty(len(axes))
        thickness = SLAB * self._radius / 2  # a layer is two bins
        bins = 128
        for start in range(0, len(axes), 50):
            heights = self._points @ axes[start : start + 50].T  # [S, A]
            index = (heights / thickness + bins / 2).clip(0, bins - 1).astype(np.int64)
            index += np.arange(index.shape[1]) * bins
            share = np.zeros(index.shape[1])
            for weights in (np.full(len(heights), 1 / len(heights)), self._areas):
                spread = np.repeat(weights, index.shape[1])
                each = np.bincount(index.ravel(), spread, bins * index.shape[1]).reshape(-1, bins)[:, 1:-1]
                share = np.maximum(share, (each[:, 1:] + each[:, :-1]).max(1))
            shares[start : start + 50] = share
        return shares

    def upright_scores(self, axes: Doubles) -> Doubles:
        """[A] evidence that each axis is vertical, regardless of sign."""
        evidence: Doubles = np.log(self.density(axes) + 0.3) + 1.5 * np.log(self.slab_shares(axes) + 0.02)
        return evidence

    def upright_score(self, axis: Doubles) -> tuple[float, float]:
        """The evidence that an axis is vertical, regardless of sign, and the share of its densest layer."""
        return float(self.upright_scores(axis[None])[0]), float(self.slab_shares(axis[None])[0])

    def sign_score(self, up: Doubles) -> float:
        """The evidence for the sign of an axis: most Gaussians are near the ground, and outliers are in the sky."""
        heights = self._points @ up
        lowest, low, middle, high, highest = np.quantile(heights, (0.001, 0.03, 0.5, 0.97, 0.999))
        reach = float(high - low)
        if reach <= 0:
            return 0.0
        skew = float(middle - (low + high) / 2) / reach
        outliers = float((highest - high) - (low - lowest)) / reach
        return -1.5 * skew + 0.4 * min(max(outliers, 0.0), 1.0)


def _prior(up: Doubles) -> float:
    """The evidence for a direction from files' usual axes. An exact match adds little, as that would hide a tilt."""
    best = 0.0
    for axis, weight in FILE_AXES:
        cosine = float(up @ axis)
        best = max(best, weight * (1.1 if cosine > 1 - 1e-9 else 1 if cosine > NEAR else 0.35 * (cosine > NOT_FAR)))
    return best


def _snap_to_file_axis(up: Doubles) -> Doubles:
    nearest = int(np.argmax(np.abs(up)))
    if abs(float(up[nearest])) < SNAP:
        return up
    exact: Doubles = np.eye(3)[nearest] * np.sign(up[nearest])
    return exact


def _hemisphere(number: int) -> Doubles:
    """[N, 3] directions distributed evenly over a hemisphere, on a Fibonacci lattice."""
    height = 1 - (np.arange(number) + 0.5) / number
    turn = np.arange(number) * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(1 - height**2)
    return np.stack((across * np.cos(turn), height, across * np.sin(turn)), 1)


def _distinct(axes: list[Doubles]) -> list[Doubles]:
    kept: list[Doubles] = []
    for axis in axes:
        if all(abs(float(axis @ other)) < 1 - 1e-9 for other in kept):
            kept.append(axis)
    return kept
