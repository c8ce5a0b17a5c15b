"""Overscan adds margins around the viewport, and leaves the viewport unchanged."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.fakes import render_request
from tests.render.raster.views import cloud, pixels
from tigas_common.errors import InvalidRequest
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest
from tigas_render.engine.frame_size import FrameSize
from tigas_render.raster.base import Image
from tigas_render.raster.cpu import CpuRasterizer

RASTERIZER = CpuRasterizer()
SCENE = RASTERIZER.prepare(cloud(1500, 3))


def render(request: RenderRequest) -> Image:
    camera = FrameSize.of(request, DEFAULT_LADDER).camera(request, (0.2, 0.5, 0.9))
    return RASTERIZER.render(SCENE, camera, "png")


@pytest.mark.parametrize("overscan", [0.05, 0.15, 0.25, 0.5])
@pytest.mark.parametrize(
    ("width", "height", "profile"),
    [(640, 360, 3), (390, 844, 3), (97, 61, None), (61, 97, None), (128, 96, None)],
)
@pytest.mark.parametrize("translation", [(0.0, 0.0, -4.0), (0.3, -0.2, -1.0)], ids=["outside", "among"])
def test_what_the_viewport_shows_is_the_frame_without_overscan(
    width: int, height: int, profile: int | None, overscan: float, translation: tuple[float, float, float]
) -> None:
    lens = {"fx": 0.6 * width, "fy": 0.6 * width, "cx": 0.47 * width, "cy": 0.52 * height}
    plain = render_request(width=width, height=height, profile=profile, translation=translation, roll=5.0, **lens)
    request = plain.model_copy(update={"overscan": overscan})
    expected, frame = pixels(render(plain)), pixels(render(request))
    size = FrameSize.of(request, DEFAULT_LADDER)
    assert frame.shape == (size.height, size.width, 3)
    rows, columns = expected.shape[:2]
    assert (size.margin_x, size.margin_y) == (round(overscan * columns), round(overscan * rows))
    shown = frame[size.margin_y : size.margin_y + rows, size.margin_x : size.margin_x + columns]
    difference = np.abs(shown.astype(int) - expected)
    # A larger number for the same pixel has fewer bits behind the point: a few values are rounded the other way.
    assert difference.max() <= 1
    assert np.count_nonzero(difference) <= 1e-3 * difference.size


@pytest.mark.parametrize("overscan", [0.05, 0.111, 0.15, 0.25, 0.333])
@pytest.mark.parametrize(("width", "height"), [(640, 360), (854, 480), (2, 2)])
def test_even_frames_stay_even(width: int, height: int, overscan: float) -> None:
    """Video's planes need it."""
    size = FrameSize.of(render_request(width=width, height=height, profile=None, overscan=overscan), DEFAULT_LADDER)
    assert size.width % 2 == size.height % 2 == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 8192, "height": 16, "overscan": 0.1},
        {"width": 4096, "height": 4096, "overscan": 0.01},
    ],
)
def test_a_frame_that_overscan_makes_too_large_is_refused(changes: dict[str, float]) -> None:
    plain = render_request(profile=None, **changes | {"overscan": 0})
    assert FrameSize.of(plain, DEFAULT_LADDER).pixels == plain.width * plain.height
    with pytest.raises(InvalidRequest, match=r"overscan: the frame would have \d+×\d+ pixels"):
        FrameSize.of(render_request(profile=None, **changes), DEFAULT_LADDER)
