"""Frames of a request: size, margins, depth and quality; and a session's video, which breaks no chain."""

from __future__ import annotations

import asyncio
import io
import threading
from typing import Any

import av
import pytest
from PIL import Image

from tests.render.engine_bench import Bench
from tests.render.fakes import render_request
from tigas_common.errors import DeadlineExceeded, InvalidRequest
from tigas_common.wire.render import FrameFormat, Rung, VideoInfo, VideoRequest
from tigas_render.frame import Client, Frame

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


ANN = Client("somewhere", "Ann")


async def shown(bench: Bench, seq: int, *, key: bool = False, **changes: Any) -> Frame:
    video = VideoRequest(bitrate_kbps=1000, key=key)
    return await bench.submit("Ann", seq=seq, format="h264", video=video, **changes)


def after(frame: Frame) -> int | None:
    assert frame.video is not None
    assert frame.format == "h264"
    return frame.video.after


async def test_views_become_a_video_that_a_decoder_can_follow(bench: Bench) -> None:
    frames = [await shown(bench, seq, key=seq == 3) for seq in (1, 2, 3, 4)]
    assert [after(frame) for frame in frames] == [None, 1, None, 3]
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    pictures = [decoder.decode(av.Packet(bytes(frame.body))) for frame in frames]
    assert [(each.width, each.height) for found in pictures for each in found] == [(320, 180)] * 4
    assert bench.rasterizer.formats == ["yuv420p"] * 4


async def test_sides_are_even_whatever_the_viewport(bench: Bench) -> None:
    frame = await shown(bench, 1, width=321, height=181, profile=None, overscan=0.1)
    assert (frame.width % 2, frame.height % 2) == (0, 0)
    assert (frame.width - 2 * frame.margin_x, frame.height - 2 * frame.margin_y) == (320, 180)


async def test_a_view_that_no_decoder_takes_is_refused(bench: Bench) -> None:
    with pytest.raises(InvalidRequest, match="4096×4096"):
        await shown(bench, 1, width=4096, height=4096, profile=None)


async def test_a_key_frame_follows_a_late_frame(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    await shown(bench, 1)
    encode = bench.engine.videos.encode

    def slowly(*args: Any) -> tuple[bytes, VideoInfo]:
        bench.now += 1
        return encode(*args)

    with monkeypatch.context() as slow:
        slow.setattr(bench.engine.videos, "encode", slowly)
        with pytest.raises(DeadlineExceeded):
            await shown(bench, 2, deadline_ms=500)
    assert [after(await shown(bench, seq)) for seq in (3, 4)] == [None, 3]


async def test_a_key_frame_follows_a_withdrawn_frame(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    await shown(bench, 1)
    videos, loop, lost = bench.engine.videos, asyncio.get_running_loop(), asyncio.Event()
    withdrawn = threading.Event()

    encode, lose = videos.encode, videos.mark_lost

    def encode_slowly(*what: Any) -> tuple[bytes, VideoInfo]:
        encoded = encode(*what)
        loop.call_soon_threadsafe(cancel)
        loop.call_soon_threadsafe(withdrawn.set)
        assert withdrawn.wait(10)
        return encoded

    def hear(*what: Any) -> None:
        lose(*what)
        lost.set()

    monkeypatch.setattr(videos, "encode", encode_slowly)
    monkeypatch.setattr(videos, "mark_lost", hear)
    request = render_request(seq=2, format="h264", video=VideoRequest(bitrate_kbps=1000))
    cancel = bench.engine.request(ANN, request, bench.now, lambda _: pytest.fail("it was withdrawn"))
    await lost.wait()
    monkeypatch.undo()
    assert after(await shown(bench, 3)) is None


async def test_a_view_that_waits_and_is_withdrawn_breaks_nothing(bench: Bench) -> None:
    await shown(bench, 1)
    bench.rasterizer.gate.clear()
    running = bench.submit("Bob")
    await bench.rendering()
    waiting = bench.submit("Ann", seq=2, format="h264", video=VideoRequest(bitrate_kbps=1000))
    await bench.waiting(1)
    waiting.cancel()
    await bench.waiting(0)
    bench.rasterizer.gate.set()
    await running
    assert after(await shown(bench, 3)) == 1


async def test_a_client_that_is_forgotten_begins_anew(bench: Bench) -> None:
    await shown(bench, 1)
    bench.engine.forget(ANN)
    assert len(bench.engine.videos) == 0
    assert after(await shown(bench, 2)) is None
