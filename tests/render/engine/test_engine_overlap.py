"""Concurrent frames of the engine: one encoded during another, a small one within a large one."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from tests.render.engine_bench import Bench, busy
from tests.render.fakes import FakeImage, FakeLaneRasterizer, FakeRasterizer, render_request
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine.frame_maker import SUFFICIENT_LANES
from tigas_render.engine.frame_size import FrameSize
from tigas_render.raster.base import Camera, Pause

pytestmark = pytest.mark.anyio


async def test_rendering_and_encoding_overlap(thread_bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first frame's encoding waits until the second frame's rendering has begun: it does not, if they overlap."""

    def encode(image: FakeImage, format: str, quality: int) -> bytes:
        if image is thread_bench.rasterizer.images[0]:
            assert thread_bench.rasterizer.started.acquire(timeout=10)
        return b"frame"

    monkeypatch.setattr(FakeImage, "encode", encode)
    first = await busy(thread_bench)
    second = thread_bench.submit("a")
    await thread_bench.waiting(1)
    thread_bench.rasterizer.gate.set()
    await asyncio.wait_for(asyncio.gather(first, second), 10)


async def test_the_rasteriser_limits_concurrent_encoding(monkeypatch: pytest.MonkeyPatch) -> None:
    rasterizer = FakeRasterizer(frames_in_flight=5)
    rasterizer.gate.set()
    together = threading.Barrier(4)

    def encode(image: FakeImage, format: str, quality: int) -> bytes:
        together.wait(10)
        return b"frame"

    monkeypatch.setattr(FakeImage, "encode", encode)
    bench = Bench(rasterizer)
    async with bench.engine:
        frames = await asyncio.wait_for(asyncio.gather(*(bench.submit("a", address=f"{n}") for n in range(4))), 20)
    assert [frame.body for frame in frames] == [b"frame"] * 4


async def test_one_address_does_not_take_every_encoder(monkeypatch: pytest.MonkeyPatch) -> None:
    rasterizer = FakeRasterizer(frames_in_flight=3)
    rasterizer.gate.set()
    let_go = threading.Event()

    def encode(image: FakeImage, format: str, quality: int) -> bytes:
        assert format == "jpeg" or let_go.wait(10)
        return b"frame"

    monkeypatch.setattr(FakeImage, "encode", encode)
    bench = Bench(rasterizer)
    async with bench.engine:
        pictures = [bench.submit("pictures", address="a", format="png") for _ in range(4)]
        for _ in range(2):
            await bench.rendering()
        frame = await asyncio.wait_for(bench.submit("viewer", address="b"), 10)
        assert frame.body == b"frame"
        assert not any(picture.done() for picture in pictures)
        let_go.set()
        await asyncio.gather(*pictures)


async def test_bursts_are_all_served_whichever_threads_are_at_rest() -> None:
    rasterizer = FakeRasterizer(frames_in_flight=4)
    rasterizer.gate.set()
    bench = Bench(rasterizer)
    async with bench.engine, asyncio.timeout(20):
        for burst in range(150):
            size = 1 + burst % 7
            await asyncio.gather(*(bench.submit(f"{number}", address=f"{number % 3}") for number in range(size)))
    assert bench.outcome("frame") == len(rasterizer.cameras) == sum(1 + burst % 7 for burst in range(150))


@dataclass
class PausingRasterizer(FakeRasterizer):
    """Pauses once the gate is open, then takes a microsecond per pixel of the test's clock."""

    frames_in_flight: int = 3
    take: Callable[[float], None] = lambda seconds: None

    def before_image(self, camera: Camera, pause: Pause | None) -> None:
        if pause is not None:
            pause()
        self.take(1e-6 * camera.intrinsics.width * camera.intrinsics.height)


@pytest.mark.parametrize(
    ("address", "profile", "first"), [("b", 3, "320x180"), ("a", 3, "1280x720"), ("b", 1, "1280x720")]
)
async def test_a_large_frame_is_interrupted_for_anothers_small_one(address: str, profile: int, first: str) -> None:
    rasterizer = PausingRasterizer()
    bench = Bench(rasterizer)

    def take(seconds: float) -> None:
        bench.now += seconds

    rasterizer.take = take
    rasterizer.gate.set()
    async with bench.engine:
        for rung in (0, profile):  # then the costs of frames are known
            await bench.submit("warm-up", address=f"{rung}", profile=rung, width=1280, height=720)
        rasterizer.gate.clear()
        rasterizer.images.clear()
        while rasterizer.started.acquire(blocking=False):
            pass
        large = bench.submit("large", address="a", profile=0, width=1280, height=720)
        await bench.rendering()
        small = bench.submit("small", address=address, profile=profile, width=1280, height=720)
        await bench.waiting(1)
        rasterizer.gate.set()
        frames = await asyncio.gather(large, small)
    assert rasterizer.images[0].text == first
    assert [round(frame.timing.render) for frame in frames] == [922, 58 if profile == 3 else 518]


@pytest.mark.parametrize(("seconds", "at_once"), [(0.1, SUFFICIENT_LANES), (0.001, 10)], ids=["slow", "quick"])
async def test_more_frames_than_keep_a_device_busy_are_begun_only_if_they_are_quick(
    seconds: float, at_once: int
) -> None:
    bench = Bench(FakeLaneRasterizer(frames_in_flight=10))
    request = render_request()
    pixels = FrameSize.of_request(request, DEFAULT_LADDER).pixels
    async with bench.engine:
        bench.engine._queue._costs.add_measurement(request.scene, request.format, pixels, seconds)
        frames = [bench.submit("viewer", address=f"{number}") for number in range(12)]
        for _ in range(at_once):
            await bench.rendering()
        await bench.waiting(12 - at_once)
        bench.rasterizer.gate.set()
        await asyncio.wait_for(asyncio.gather(*frames), 20)
    assert bench.outcome("frame") == 12
