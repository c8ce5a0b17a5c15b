"""The reference rasteriser, with which the fast ones are compared, against results worked out by hand; and depth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from reference.rasterizer import ReferenceRasterizer, render_float, sh_basis
from tests.render.raster.views import balls, camera, pixels
from tigas_render.raster.base import ALPHA_MAX, DILATION, Depth, coarse, depth_size, derivative_limits, inverse_depth


def test_one_gaussian_falls_off_as_the_formula_says() -> None:
    scene = balls((0.0, 0.0, 0.0), size=0.1, opacity=0.8, colours=[[1.0, 0.5, 0.25]])
    picture = render_float(scene, camera(65, 65, focal=100.0))
    variance = (100 / 4 * 0.1) ** 2 + DILATION
    for offset in (0, 1, 3):
        alpha = 0.8 * math.exp(-(offset**2) / (2 * variance))
        torch.testing.assert_close(picture[32, 32 + offset], alpha * torch.tensor([1.0, 0.5, 0.25]), atol=1e-4, rtol=0)
    assert picture[0, 0].eq(0).all()


def test_nearer_gaussians_hide_farther_ones_and_the_background() -> None:
    red, green = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    scene = balls((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), size=1.0, opacity=0.5, colours=[green, red])
    rasterizer = ReferenceRasterizer()
    picture = pixels(rasterizer.render(rasterizer.prepare(scene), camera(9, 9, background=(0.0, 0.0, 1.0))))
    np.testing.assert_allclose(picture[4, 4], [127.5, 63.75, 63.75], atol=1.5)


def test_a_gaussian_that_would_end_the_light_is_not_drawn() -> None:
    scene = balls(*[(0.0, 0.0, z) for z in (0.0, 0.5, 1.0)], size=5.0, opacity=1.0, colours=[[1.0, 1.0, 1.0]] * 3)
    picture = render_float(scene, camera(3, 3, background=(0.0, 0.0, 0.0)))
    assert picture[1, 1, 0].item() == pytest.approx(ALPHA_MAX, abs=1e-4)


def test_the_basis_is_orthonormal() -> None:
    points = torch.nn.functional.normalize(torch.randn(200_000, 3, generator=torch.Generator().manual_seed(1)), dim=1)
    basis = sh_basis(points.double(), 16)
    products = 4 * math.pi * basis.T @ basis / len(points)
    torch.testing.assert_close(products, torch.eye(16, dtype=torch.float64), atol=0.03, rtol=0)


GREY = [0.5, 0.5, 0.5]
SLOW = ReferenceRasterizer()


def depth_of(*centres: tuple[float, float, float], opacity: float, size: float = 2.0) -> Depth:
    gaussians = balls(*centres, size=size, opacity=opacity, colours=[GREY] * len(centres))
    with SLOW.render(SLOW.prepare(gaussians), camera(64, 36), depth=True) as image:
        assert image.depth is not None
        return image.depth


@pytest.mark.parametrize(
    ("picture", "expected"),
    [
        ((1280, 720), (184, 104)),
        ((640, 360), (184, 104)),
        ((1664, 936), (184, 104)),
        ((720, 1280), (104, 184)),
        ((320, 180), (160, 90)),
        ((1, 1), (1, 1)),
        ((8192, 1), (4096, 1)),
    ],
)
def test_a_map_has_a_number_of_pixels_in_the_pictures_shape_but_is_always_coarse(
    picture: tuple[int, int], expected: tuple[int, int]
) -> None:
    assert depth_size(*picture) == expected


def test_a_wall_has_the_inverse_of_its_depth_however_transparent_it_is() -> None:
    for opacity in (0.3, 0.999):
        centre = depth_of((0.0, 0.0, 0.0), opacity=opacity)[9, 16]  # four units before the camera
        assert centre == pytest.approx(1 / 4, rel=1e-3)


def test_what_is_behind_counts_as_far_as_it_is_seen() -> None:
    centre = depth_of((0.0, 0.0, 0.0), (0.0, 0.0, 4.0), opacity=0.5)[9, 16]
    assert centre == pytest.approx((0.5 / 4 + 0.25 / 8) / 0.75, rel=0.02)


def test_where_nearly_nothing_is_it_is_infinitely_far() -> None:
    depth = depth_of((0.0, 0.0, 0.0), opacity=0.999, size=0.05)
    assert depth[0, 0] == 0
    assert depth[9, 16] > 0.2
    means = np.array([[[0, 0], [0.01, 0.04], [0.1, 0.4]]], np.float32)
    assert inverse_depth(means).tolist() == [[0, 0, 0.25]]


def test_the_coarse_view_is_the_same_view() -> None:
    view = replace(camera(832, 468), margins=(96, 54), display_scale=2.0, background=(1.0, 0.0, 0.0))
    small = coarse(view)
    k, c = view.intrinsics, small.intrinsics
    assert (c.width, c.height) == depth_size(832, 468)
    assert (c.cx / c.width, c.fx / c.width) == pytest.approx((k.cx / k.width, k.fx / k.width))
    assert small.display_scale * c.width == pytest.approx(view.display_scale * k.width, rel=0.01)
    assert derivative_limits(small.viewport) == pytest.approx(derivative_limits(view.viewport), rel=0.02)
    assert small.background == (0, 0, 0)
