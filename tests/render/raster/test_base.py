"""Shared code of the fast rasterisers."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.raster.views import camera
from tigas_common.pose import Intrinsics
from tigas_render.raster.base import DILATION, derivative_limits, footprint


def test_derivative_limits_lie_outside_the_picture() -> None:
    assert derivative_limits(camera(200, 100, focal=100).intrinsics) == pytest.approx((-1.3, 1.3, -0.65, 0.65))


def test_derivative_limits_follow_an_off_centre_picture() -> None:
    assert derivative_limits(Intrinsics(100, 100, 50, 50, 200, 100)) == pytest.approx((-0.8, 1.8, -0.65, 0.65))


def test_a_picture_of_the_displays_own_size_has_the_footprint_of_training() -> None:
    assert footprint(1) == (DILATION, 0)


@pytest.mark.parametrize("scale", [1, 2, 3])
def test_a_scene_trained_with_the_filter_is_as_wide_and_pays_with_opacity(scale: int) -> None:
    dilation, low_pass = footprint(scale, antialiased=True)
    assert dilation == 0
    assert low_pass == pytest.approx(sum(footprint(scale)))


@pytest.mark.parametrize("scale", [2, 3, 4])
def test_the_low_pass_has_half_the_variance_of_the_displays_pixels_within_one_of_the_pictures(scale: int) -> None:
    dilation, low_pass = footprint(scale)
    assert dilation * scale**2 == pytest.approx(DILATION)
    assert low_pass == pytest.approx(np.var(np.arange(scale) / scale) / 2)
