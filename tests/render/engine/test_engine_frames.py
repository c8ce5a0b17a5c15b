"""Frames of a request: size, margins, depth and quality."""

from __future__ import annotations

import io
from functools import partial

import pytest
from PIL import Image

from tests.render.engine_bench import Bench
from tigas_common.errors import InvalidRequest
from tigas_common.wire.render import FrameFormat, Rung

pytestmark = pytest.mark.anyio


async def test_the_frame_has_the_rungs_resolution_and_quality_and_the_requests_number(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    frame = await bench.submit("a", seq=7, profile=1)
    assert (frame.body, frame.seq, frame.profile) == (b"960x540 jpeg 65", 7, 1)
    camera = bench.rasterizer.cameras[0]
    assert (camera.intrinsics.fx, camera.intrinsics.cx, camera.intrinsics.cy) == (900, 480, 270)
    assert camera.background == (0.0, 0.5, 1.0)
    assert bench.rasterizer.images[0].closed
    assert bench.scenes.users == 0
    assert bench.outcome("frame") == 1


async def test_profiles_count_in_the_scenes_own_ladder(bench: Bench) -> None:
    sizes = ((1280, 720, 80), (480, 270, 50))
    bench.scenes.ladder = tuple(
        Rung(name=f"{width}", width=width, height=height, quality=quality, expected_kb=width)
        for width, height, quality in sizes
    )
    bench.rasterizer.gate.set()
    assert (await bench.submit("a", profile=1)).body == b"480x270 jpeg 50"
    assert (await bench.submit("a", profile=None)).body == b"320x180 jpeg 80"
    with pytest.raises(InvalidRequest, match="rungs 0 to 1"):
        await bench.submit("a", profile=2)
    assert bench.scenes.users == 0


async def test_overscan_adds_margins_at_the_same_pixels_per_angle(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    frame = await bench.submit("a", width=1280, height=720, cx=640.0, cy=360.0, profile=2, overscan=0.15)
    assert frame.body == b"832x468 jpeg 35"
    assert (frame.width, frame.height, frame.margin_x, frame.margin_y) == (832, 468, 96, 54)
    camera = bench.rasterizer.cameras[0]
    k = camera.intrinsics
    assert (k.fx, k.fy, k.cx, k.cy, k.width, k.height) == (150, 150, 416, 234, 832, 468)
    assert camera.display_scale == 2


async def test_a_frame_that_overscan_makes_too_large_is_refused(bench: Bench) -> None:
    with pytest.raises(InvalidRequest, match="overscan: the frame would have 8192×8192 pixels"):
        await bench.submit("a", width=4096, height=4096, profile=None, overscan=0.5)
    assert bench.rasterizer.cameras == []


async def test_a_jpeg_carries_its_depth_when_it_is_asked_for(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    plain, deep = await bench.submit("a", profile=3), await bench.submit("a", profile=3, depth=True)
    assert plain.body == b"320x180 jpeg 10"
    body = bytes(deep.body)
    assert body.startswith(b"\xff\xd8\xff\xe9")
    assert b"tigas:depth" in body
    assert body.endswith(bytes(plain.body))


async def test_a_webp_is_one_and_carries_its_depth_when_it_is_asked_for(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    asked = partial(bench.submit, "a", profile=3, format="webp")
    plain, deep = await asked(), await asked(depth=True)
    assert (plain.content_type, deep.content_type) == ("image/webp", "image/webp")
    assert Image.open(io.BytesIO(plain.body)).format == "WEBP"
    assert Image.open(io.BytesIO(plain.body)).size == (320, 180)
    assert b"TDEP" not in bytes(plain.body)
    assert b"TDEP" in bytes(deep.body)


@pytest.mark.parametrize("format", ["png", "yuv420p"])
async def test_other_formats_have_no_depth_and_pay_for_none(thread_bench: Bench, format: FrameFormat) -> None:
    thread_bench.rasterizer.gate.set()
    assert (
        await thread_bench.submit("a", profile=3, depth=True, format=format)
    ).body == f"320x180 {format} 10".encode()
    assert thread_bench.rasterizer.images[0].depth is None


async def test_without_a_profile_the_frame_has_the_viewports_resolution(thread_bench: Bench) -> None:
    thread_bench.rasterizer.gate.set()
    frame = await thread_bench.submit("a", profile=None, format="png")
    assert frame.body == b"320x180 png 90"
    assert thread_bench.rasterizer.cameras[0].display_scale == 1


@pytest.mark.parametrize(
    ("viewport", "profile", "scale"),
    [((1280, 720), 0, 1), ((1280, 720), 1, 4 / 3), ((1280, 720), 3, 4), ((640, 360), 0, 1), ((390, 844), 2, 1.195)],
)
async def test_frames_are_rendered_for_the_viewport_that_they_are_shown_on(
    bench: Bench, viewport: tuple[int, int], profile: int, scale: float
) -> None:
    bench.rasterizer.gate.set()
    await bench.submit("a", width=viewport[0], height=viewport[1], profile=profile)
    assert bench.rasterizer.cameras[0].display_scale == pytest.approx(scale, rel=1e-3)


async def test_a_viewport_may_itself_be_shown_larger(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    await bench.submit("a", width=1280, height=720, profile=None, display_scale=2)
    await bench.submit("a", width=1280, height=720, profile=2, display_scale=2)
    await bench.submit("a", width=640, height=360, profile=0, display_scale=3)
    assert [camera.display_scale for camera in bench.rasterizer.cameras] == pytest.approx([2, 4, 1.5])


async def test_a_portrait_viewport_gets_as_many_square_pixels(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    frame = await bench.submit("a", width=390, height=844, fx=500.0, fy=500.0, profile=2)
    assert frame.width * frame.height == pytest.approx(640 * 360, rel=0.01)
    assert frame.width / frame.height == pytest.approx(390 / 844, rel=0.01)
    intrinsics = bench.rasterizer.cameras[0].intrinsics
    assert intrinsics.fx == pytest.approx(intrinsics.fy, rel=0.01)


async def test_the_rasteriser_hears_what_the_frame_will_be_encoded_as(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    await bench.submit("a", format="yuv420p")
    assert bench.rasterizer.formats == ["yuv420p"]
