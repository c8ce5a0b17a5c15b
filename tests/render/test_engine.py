"""The engine answers every request once, keeps clients apart, and never makes the event loop wait."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Any

import pytest

from tests.render.fakes import FakeImage, FakeRasterizer, FakeScenes, render_request
from tigas_common.errors import (
    DeadlineExceeded,
    DeviceLost,
    InvalidRequest,
    OutOfDeviceMemory,
    Overloaded,
    Superseded,
    UnknownScene,
)
from tigas_common.wire.render import DEFAULT_LADDER, FrameFormat, Rung
from tigas_render import engine as engine_module
from tigas_render.engine import Engine
from tigas_render.frame import Client, Frame
from tigas_render.metrics import EngineMetrics
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene

pytestmark = pytest.mark.anyio


@dataclass
class Bench:
    """An engine over stand-ins, with a clock that the test sets."""

    rasterizer: FakeRasterizer = field(default_factory=FakeRasterizer)
    scenes: FakeScenes = field(default_factory=FakeScenes)
    metrics: EngineMetrics = field(default_factory=EngineMetrics)
    now: float = 1000.0
    waiting_per_address: int = 128

    def __post_init__(self) -> None:
        self.engine = Engine(
            self.rasterizer, self.scenes, DEFAULT_LADDER, self.metrics, lambda: self.now, self.waiting_per_address
        )

    async def rendering(self) -> None:
        """Wait until the rasteriser has begun one more frame."""
        assert await asyncio.to_thread(self.rasterizer.started.acquire, True, 10)

    def submit(
        self, session: str, *, address: str = "somewhere", waited: float = 0.0, **changes: object
    ) -> asyncio.Task[Frame]:
        """A request that arrived so many seconds ago."""
        client = Client(address, session)
        return asyncio.create_task(self.engine.submit(client, render_request(**changes), self.now - waited))

    async def waiting(self, count: int) -> None:
        """Wait until so many requests wait."""
        async with asyncio.timeout(10):
            while len(self.engine._schedule) != count:  # noqa: ASYNC110 - nothing announces it
                await asyncio.sleep(0)

    def outcome(self, name: str) -> float:
        return self.metrics.registry.get_sample_value("tigas_requests_total", {"outcome": name}) or 0.0


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    bench = Bench()
    async with bench.engine:
        yield bench
        bench.rasterizer.gate.set()


async def busy(bench: Bench) -> asyncio.Task[Frame]:
    """Keep the rasteriser busy with a frame, so that whatever comes next has to wait."""
    task = bench.submit("somebody else")
    await bench.rendering()
    return task


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
    assert deep.body.startswith(b"\xff\xd8\xff\xe9")
    assert b"tigas:depth" in deep.body
    assert deep.body.endswith(plain.body)
    stamped = await bench.submit("a", profile=3, depth=True, stamp=7)
    assert b"tigas:depth" in stamped.body


@pytest.mark.parametrize("format", ["png", "yuv420p"])
async def test_other_formats_have_no_depth_and_pay_for_none(bench: Bench, format: FrameFormat) -> None:
    bench.rasterizer.gate.set()
    assert (await bench.submit("a", profile=3, depth=True, format=format)).body == f"320x180 {format} 10".encode()
    assert bench.rasterizer.images[0].depth is None


async def test_without_a_profile_the_frame_has_the_viewports_resolution(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    frame = await bench.submit("a", profile=None, format="png")
    assert frame.body == b"320x180 png 90"
    assert bench.rasterizer.cameras[0].display_scale == 1


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


async def test_a_client_that_floods_does_not_hold_up_another(bench: Bench) -> None:
    first = await busy(bench)
    flood = [bench.submit("flooder", seq=seq) for seq in range(50)]
    await bench.waiting(engine_module.QUEUE_DEPTH)
    patient = bench.submit("patient", seq=99)
    await bench.waiting(engine_module.QUEUE_DEPTH + 1)
    order: list[int] = []
    for task in (*flood, patient):
        task.add_done_callback(lambda t: None if t.exception() else order.append(t.result().seq))
    bench.rasterizer.gate.set()
    results = await asyncio.gather(first, patient, *flood, return_exceptions=True)
    superseded = [result for result in results if isinstance(result, Superseded)]
    assert len(superseded) == 50 - engine_module.QUEUE_DEPTH
    assert order[:2] == [49, 99]
    assert order[2:] == [48, 47, 46]
    assert bench.outcome("superseded") == len(superseded)


async def test_a_withdrawn_request_is_not_rendered(bench: Bench) -> None:
    first = await busy(bench)
    withdrawn = bench.submit("a")
    await bench.waiting(1)
    withdrawn.cancel()
    with pytest.raises(asyncio.CancelledError):
        await withdrawn
    bench.rasterizer.gate.set()
    await first
    assert len(bench.rasterizer.cameras) == 1
    assert bench.scenes.users == 0
    assert bench.outcome("cancelled") == 1


async def test_a_request_withdrawn_while_it_is_rendered_gives_its_image_back(bench: Bench) -> None:
    task = await busy(bench)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    bench.rasterizer.gate.set()
    await bench.submit("a")
    assert all(image.closed for image in bench.rasterizer.images)


async def test_a_request_past_its_deadline_is_shed_and_others_are_not(bench: Bench) -> None:
    first = await busy(bench)
    late, patient = bench.submit("a", deadline_ms=50), bench.submit("b", deadline_ms=5000)
    await bench.waiting(2)
    bench.now += 1
    bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded, match="50 ms"):
        await late
    assert (await patient).timing.queue == 1000
    await first
    assert len(bench.rasterizer.cameras) == 2


async def test_time_counts_from_the_requests_arrival(bench: Bench) -> None:
    """Under load a request waits for the transport, too."""
    bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded, match="100 ms"):
        await bench.submit("a", waited=0.2, deadline_ms=100)
    assert bench.rasterizer.cameras == []
    assert (await bench.submit("a", waited=0.2)).timing.queue == 200


async def test_a_frame_that_was_ready_too_late_is_not_sent(bench: Bench) -> None:
    late = bench.submit("a", deadline_ms=100)
    await bench.rendering()
    bench.now += 0.2
    bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded):
        await late
    assert bench.outcome("deadline-exceeded") == 1


async def test_a_huge_frame_is_refused_while_another_client_wants_frames(bench: Bench) -> None:
    huge: dict[str, Any] = {"width": 4096, "height": 4096, "profile": None}
    alone = bench.submit("hostile", **huge)
    await bench.rendering()
    queued = [bench.submit("hostile", **huge) for _ in range(3)]
    await bench.waiting(3)
    polite = bench.submit("polite")
    await bench.waiting(4)
    bench.now += 3
    bench.rasterizer.gate.set()
    assert (await alone).width == 4096
    assert (await polite).width == 320
    for task in queued:
        with pytest.raises(Overloaded, match="4096×4096 pixels"):
            await task
    bench.now += 10
    assert (await bench.submit("hostile", **huge)).width == 4096, "nobody else is there any more"


async def test_an_image_that_nobody_wants_is_not_encoded_but_paid_for(bench: Bench) -> None:
    task = await busy(bench)
    bench.now += 1.0
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    bench.rasterizer.gate.set()
    async with asyncio.timeout(10):
        while not (bench.rasterizer.images and bench.rasterizer.images[0].closed):  # noqa: ASYNC110 - as above
            await asyncio.sleep(0)
    assert bench.rasterizer.images[0].encoded == 0
    assert bench.engine._schedule._addresses._starts["somewhere"] == pytest.approx(1.0)


async def test_a_request_that_cannot_be_ready_in_time_is_shed_but_not_for_ever(bench: Bench) -> None:
    """After a slow first frame, hopeless deadlines are refused; the estimate then fades until one is tried again."""
    first = await busy(bench)
    bench.now += 0.2
    bench.rasterizer.gate.set()
    await first
    with pytest.raises(DeadlineExceeded):
        await bench.submit("a", deadline_ms=100)
    for _ in range(20):
        try:
            await bench.submit("a", deadline_ms=100)
        except DeadlineExceeded:
            continue
        break
    else:
        pytest.fail("one slow frame turned every later request away")


async def test_one_frame_is_rendered_while_another_is_encoded(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first frame's encoding waits until the second frame's rendering has begun: it does not, if they overlap."""

    def encode(image: FakeImage, format: str, quality: int) -> bytes:
        if image is bench.rasterizer.images[0]:
            assert bench.rasterizer.started.acquire(timeout=10)
        return b"frame"

    monkeypatch.setattr(FakeImage, "encode", encode)
    first = await busy(bench)
    second = bench.submit("a")
    await bench.waiting(1)
    bench.rasterizer.gate.set()
    await asyncio.wait_for(asyncio.gather(first, second), 10)


async def test_a_rasteriser_that_fails_fails_that_request_alone(bench: Bench) -> None:
    bench.rasterizer.error = RuntimeError("out of luck")
    bench.rasterizer.gate.set()
    with pytest.raises(RuntimeError):
        await bench.submit("a")
    bench.rasterizer.error = None
    for _ in range(bench.rasterizer.frames_in_flight + 1):
        assert (await bench.submit("a")).body


async def test_a_lost_device_is_remembered(bench: Bench) -> None:
    bench.rasterizer.error = RuntimeError("out of luck")
    bench.rasterizer.gate.set()
    with pytest.raises(RuntimeError):
        await bench.submit("a")
    assert not bench.engine.device_lost.done()
    for _ in range(2):
        bench.rasterizer.error = DeviceLost("gone")
        with pytest.raises(DeviceLost):
            await bench.submit("a")
        assert bench.engine.device_lost.result().detail == "gone"


async def test_wrong_scene_and_rung_are_refused_before_anything_is_queued(bench: Bench) -> None:
    with pytest.raises(UnknownScene):
        await bench.submit("a", scene="../../etc/passwd")
    with pytest.raises(InvalidRequest, match="rungs 0 to 3"):
        await bench.submit("a", profile=4)
    assert bench.rasterizer.cameras == []


async def test_too_many_waiting_requests_are_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_module, "MAX_WAITING", 3)
    first = await busy(bench)
    tasks = [bench.submit(f"client {number}") for number in range(3)]
    await bench.waiting(3)
    with pytest.raises(Overloaded, match="ask less often"):
        await bench.submit("one more")
    bench.rasterizer.gate.set()
    assert all(frame.body for frame in await asyncio.gather(first, *tasks))


async def test_one_address_cannot_take_all_places() -> None:
    bench = Bench(waiting_per_address=3)
    async with bench.engine:
        first = await busy(bench)
        tasks = [bench.submit(f"session {number}", address="hostile") for number in range(3)]
        await bench.waiting(3)
        with pytest.raises(Overloaded, match="from this address"):
            await bench.submit("one more", address="hostile")
        tasks.append(bench.submit("polite", address="elsewhere"))
        bench.rasterizer.gate.set()
        assert all(frame.body for frame in await asyncio.gather(first, *tasks))


async def test_closing_finishes_what_is_rendered_and_refuses_what_waits() -> None:
    bench = Bench()
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(bench.engine)
        rendered = await busy(bench)
        waiting = bench.submit("a")
        await bench.waiting(1)
        closing = asyncio.create_task(stack.aclose())
        with pytest.raises(Overloaded, match="stopping"):
            await waiting
        bench.rasterizer.gate.set()
        await closing
    assert (await rendered).body
    with pytest.raises(Overloaded, match="stopping"):
        await bench.submit("a")


async def test_when_the_device_is_full_a_scene_goes_and_the_frame_is_tried_once_more(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    bench.scenes.evictable = 1
    bench.rasterizer.error = OutOfDeviceMemory("full")
    with pytest.raises(OutOfDeviceMemory):
        await bench.submit("a")
    assert (len(bench.rasterizer.cameras), bench.scenes.evicted) == (2, 1)
    with pytest.raises(OutOfDeviceMemory):
        await bench.submit("a")
    assert len(bench.rasterizer.cameras) == 3
    assert bench.scenes.users == 0


async def test_a_scene_is_let_go_when_its_frame_is_done(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    await bench.submit("a")
    last = bench.scenes.last
    assert last is not None
    async with asyncio.timeout(10):
        while last() is not None:  # noqa: ASYNC110 - nothing announces it
            await asyncio.sleep(0)


async def test_the_rasteriser_hears_what_the_frame_will_be_encoded_as(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    await bench.submit("a", format="yuv420p")
    assert bench.rasterizer.formats == ["yuv420p"]


async def test_as_many_images_are_encoded_at_a_time_as_the_rasteriser_allows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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


@dataclass
class PausingRasterizer(FakeRasterizer):
    """Takes a microsecond a pixel of the test's clock, and pauses once the gate lets it."""

    frames_in_flight: int = 3
    take: Callable[[float], None] = lambda seconds: None

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        self.started.release()
        assert self.gate.wait(10)
        if pause is not None:
            pause()
        self.take(1e-6 * camera.intrinsics.width * camera.intrinsics.height)
        return super().render(scene, camera, format, depth=depth)


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
        for rung in (0, profile):  # what frames cost is known then
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
