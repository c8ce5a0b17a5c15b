"""What the fast rasterisers share."""

from __future__ import annotations

import pytest

from tests.render.raster.views import camera
from tigas_common.pose import Intrinsics
from tigas_render.raster.base import derivative_limits


def test_derivative_limits_lie_outside_the_picture() -> None:
    assert derivative_limits(camera(200, 100, focal=100).intrinsics) == pytest.approx((-1.3, 1.3, -0.65, 0.65))


def test_derivative_limits_follow_an_off_centre_picture() -> None:
    assert derivative_limits(Intrinsics(100, 100, 50, 50, 200, 100)) == pytest.approx((-0.8, 1.8, -0.65, 0.65))
