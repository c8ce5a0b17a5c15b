"""Pictures shown enlarged: fine structures keep their brightness and swell less."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from reference.rasterizer import ReferenceRasterizer, render_float
from tests.render.arrays import gaussians_of
from tests.render.raster.views import balls, camera, pixels
from tigas_render.raster.base import DILATION, Camera, Rasterizer
from tigas_render.raster.cpu import CpuRasterizer

WIDTH, HEIGHT = 192, 96
"""Of the display, in pixels."""
WIRE = gaussians_of(
    means=[[0.0, 0.0, 0.0]],
    scales=[[0.001, 3.0, 0.001]],
    quaternions=[[1.0, 0.0, 0.0, 0.0]],
    opacities=[0.95],
    sh=np.full((1, 1, 3), 0.5 / 0.28209479177387814),
)
"""A bright, upright line, far thinner than a pixel."""


def shifted(view: Camera) -> Iterator[Camera]:
    """Views from positions a quarter of a pixel apart: samples between all pixels."""
    lens = view.intrinsics
    for x in range(4):
        for y in range(4):
            moved = dataclasses.replace(lens, cx=lens.cx + x / 4, cy=lens.cy + y / 4)
            yield dataclasses.replace(view, intrinsics=moved)


def wire(rasterizer: Rasterizer, scale: int, display_scale: float) -> tuple[float, float]:
    """Brightness and width of the wire in the display's pixels, on a picture `scale` times smaller than the
    display.

    Each of the picture's pixels is shown as a square. The width is a standard deviation.
    """
    scene, sums, widths = rasterizer.prepare(WIRE), [], []
    for view in shifted(camera(WIDTH // scale, HEIGHT // scale, display_scale=display_scale)):
        picture = pixels(rasterizer.render(scene, view)).astype(float)
        line = np.repeat(picture[HEIGHT // scale // 2, :, 1], scale)
        sums.append(line.sum())
        widths.append(_deviation(line))
    return float(np.mean(sums)), float(np.mean(widths))


def _deviation(line: NDArray[np.float64]) -> float:
    places = np.arange(len(line))
    return math.sqrt(np.average((places - np.average(places, weights=line)) ** 2, weights=line))


@pytest.mark.parametrize("rasterizer", [CpuRasterizer(), ReferenceRasterizer()], ids=lambda each: each.device)
@pytest.mark.parametrize("scale", [2, 4])
def test_a_fine_line_keeps_its_brightness_and_swells_less(rasterizer: Rasterizer, scale: int) -> None:
    wanted, _ = wire(rasterizer, 1, 1)
    got, width = wire(rasterizer, scale, scale)
    swollen, swollen_width = wire(rasterizer, scale, 1)
    assert got == pytest.approx(wanted, rel=0.05)
    assert swollen > 1.8 * wanted
    assert width < 0.8 * swollen_width


@pytest.mark.parametrize("display_scale", [4 / 3, 2, 4])
@pytest.mark.parametrize("size", [1e-9, 0.01, 0.3])
def test_a_gaussian_covers_as_much_whatever_the_filter(size: float, display_scale: float) -> None:
    opacity, focal = 0.9, 40.0  # 4 units away: 10 pixels a unit
    scene = balls((0.0, 0.0, 0.0), size=size, opacity=opacity, colours=[[1.0, 1.0, 1.0]])
    view = camera(41, 41, focal=focal, display_scale=display_scale)
    covered = np.mean([render_float(scene, each)[..., 0].sum().item() for each in shifted(view)])
    variance = (10 * size) ** 2 + DILATION / display_scale**2
    assert covered == pytest.approx(2 * math.pi * opacity * variance, rel=0.04)


@pytest.mark.parametrize("rasterizer", [CpuRasterizer(), ReferenceRasterizer()], ids=lambda each: each.device)
def test_a_ball_trained_with_the_filter_is_as_bright_as_what_it_covers(rasterizer: Rasterizer) -> None:
    """Without the flag, a ball far smaller than a pixel is as bright as one of a pixel's size."""
    lens = camera(64, 64, focal=64)
    for size in (0.01, 0.05):
        ball = balls((0.0, 0.0, 0.0), size=size, opacity=0.9, colours=[[1.0, 1.0, 1.0]])
        plain, filtered = (
            pixels(rasterizer.render(rasterizer.prepare(each), lens)).astype(float).sum()
            for each in (ball, dataclasses.replace(ball, antialiased=True))
        )
        variance = (64 * size / 4) ** 2  # in pixels²
        assert filtered / plain == pytest.approx(variance / (variance + DILATION), abs=0.03)
