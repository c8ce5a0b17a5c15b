"""The reference rasteriser against results worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from reference.rasterizer import ReferenceRasterizer, render_float, sh_basis
from tests.render.raster.views import balls, camera, pixels
from tigas_render.raster.base import ALPHA_MAX, DILATION


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
