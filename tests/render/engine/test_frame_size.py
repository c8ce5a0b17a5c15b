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
    camera = FrameSize.of_request(request, DEFAULT_LADDER).camera(request, (0.2, 0.5, 0.9))
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
    size = FrameSize.of_request(request, DEFAULT_LADDER)
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
    size = FrameSize.of_request(
        render_request(width=width, height=height, profile=None, overscan=overscan), DEFAULT_LADDER
    )
    assert size.width % 2 == size.height % 2 == 0


@pytest.mark.parametrize(
    ("changes", "is_full"),
    [({}, False), ({"format": "webp"}, False), ({"detail": "full"}, True), ({"format": "png"}, True)],
)
def test_full_detail_is_drawn_on_request_and_for_pngs(changes: dict[str, str], is_full: bool) -> None:
    request = render_request(**changes)
    camera = FrameSize.of_request(request, DEFAULT_LADDER).camera(request, (0.0, 0.0, 0.0))
    assert camera.full_detail == is_full


@pytest.mark.parametrize(("width", "height", "overscan"), [(8192, 16, 0.1), (4096, 4096, 0.01)])
def test_a_frame_that_overscan_makes_too_large_is_refused(width: int, height: int, overscan: float) -> None:
    plain = render_request(profile=None, width=width, height=height)
    assert FrameSize.of_request(plain, DEFAULT_LADDER).pixels == width * height
    with pytest.raises(InvalidRequest, match=r"overscan: the frame would have \d+×\d+ pixels"):
        FrameSize.of_request(plain.model_copy(update={"overscan": overscan}), DEFAULT_LADDER)


@pytest.mark.parametrize(
    ("viewport", "profile", "display_scale", "scale"),
    [
        ((1280, 720), 0, 1, 1),
        ((1280, 720), 1, 1, 4 / 3),
        ((1280, 720), 3, 1, 4),
        ((640, 360), 0, 1, 1),
        ((390, 844), 2, 1, 1.195),
        ((320, 180), None, 1, 1),
        # a viewport that is itself shown larger
        ((1280, 720), None, 2, 2),
        ((1280, 720), 2, 2, 4),
        ((640, 360), 0, 3, 1.5),
    ],
)
def test_frames_are_rendered_for_the_display_that_they_are_shown_on(
    viewport: tuple[int, int], profile: int | None, display_scale: float, scale: float
) -> None:
    width, height = viewport
    request = render_request(width=width, height=height, profile=profile, display_scale=display_scale)
    camera = FrameSize.of_request(request, DEFAULT_LADDER).camera(request, (0, 0, 0))
    assert camera.display_scale == pytest.approx(scale, rel=1e-3)


def test_a_portrait_viewport_gets_as_many_square_pixels() -> None:
    request = render_request(width=390, height=844, fx=500.0, fy=500.0, profile=2)
    lens = FrameSize.of_request(request, DEFAULT_LADDER).camera(request, (0, 0, 0)).intrinsics
    assert lens.width * lens.height == pytest.approx(640 * 360, rel=0.01)
    assert lens.width / lens.height == pytest.approx(390 / 844, rel=0.01)
    assert lens.fx == pytest.approx(lens.fy, rel=0.01)
