"""Frames of a request: size, margins, depth and quality."""

from __future__ import annotations

import io

import pytest
from PIL import Image

from tests.render.engine_bench import Bench
from tigas_common.errors import InvalidRequest
from tigas_common.wire.render import FrameFormat, Rung

pytestmark = pytest.mark.anyio


@pytest.fixture(autouse=True)
def at_once(bench: Bench) -> None:
    """Let every frame be rendered at once."""
    bench.rasterizer.gate.set()


async def test_the_frame_has_the_rungs_resolution_and_quality_and_the_requests_number(bench: Bench) -> None:
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
    assert (await bench.submit("a", profile=1)).body == b"480x270 jpeg 50"
    assert (await bench.submit("a", profile=None)).body == b"320x180 jpeg 80"
    with pytest.raises(InvalidRequest, match="rungs 0 to 1"):
        await bench.submit("a", profile=2)
    assert bench.scenes.users == 0


async def test_overscan_adds_margins_at_the_same_pixels_per_angle(bench: Bench) -> None:
    frame = await bench.submit("a", width=1280, height=720, cx=640.0, cy=360.0, profile=2, overscan=0.15)
    assert frame.body == b"832x468 jpeg 35"
    assert (frame.width, frame.height, frame.margin_x, frame.margin_y) == (832, 468, 96, 54)
    camera = bench.rasterizer.cameras[0]
    k = camera.intrinsics
    assert (k.fx, k.fy, k.cx, k.cy, k.width, k.height) == (150, 150, 416, 234, 832, 468)
    assert camera.display_scale == 2


async def test_a_jpeg_carries_its_depth_when_it_is_asked_for(bench: Bench) -> None:
    plain, deep = await bench.submit("a"), await bench.submit("a", depth=True)
    assert plain.body == b"320x180 jpeg 10"
    body = bytes(deep.body)
    assert body.startswith(b"\xff\xd8\xff\xe9")
    assert b"tigas:depth" in body
    assert body.endswith(bytes(plain.body))


async def test_a_webp_is_one_and_carries_its_depth_when_it_is_asked_for(bench: Bench) -> None:
    plain, deep = await bench.submit("a", format="webp"), await bench.submit("a", format="webp", depth=True)
    assert (plain.content_type, deep.content_type) == ("image/webp", "image/webp")
    assert Image.open(io.BytesIO(plain.body)).format == "WEBP"
    assert Image.open(io.BytesIO(plain.body)).size == (320, 180)
    assert b"TDEP" not in bytes(plain.body)
    assert b"TDEP" in bytes(deep.body)


@pytest.mark.parametrize("format", ["png", "yuv420p"])
async def test_other_formats_have_no_depth_and_pay_for_none(bench: Bench, format: FrameFormat) -> None:
    frame = await bench.submit("a", depth=True, profile=None, format=format)
    assert (frame.width, frame.height) == (320, 180), "the viewport's own resolution"
    assert bench.rasterizer.formats == [format], "the rasteriser knows the purpose"
    assert bench.rasterizer.images[0].depth is None
