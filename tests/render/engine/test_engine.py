"""The engine answers every request once, keeps clients apart, and never makes the event loop wait."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from typing import Any

import pytest

from tests.eventually import eventually
from tests.render.engine_bench import Bench, busy
from tests.render.fakes import render_request
from tigas_common.errors import (
    DeadlineExceeded,
    DeviceLost,
    InvalidRequest,
    OutOfDeviceMemory,
    Overloaded,
    Superseded,
    UnknownScene,
)
from tigas_render.engine import work_queue
from tigas_render.engine.engine import STUCK_S
from tigas_render.frame import Client, Frame

pytestmark = pytest.mark.anyio


async def test_a_client_that_floods_does_not_hold_up_another(bench: Bench) -> None:
    first = await busy(bench)
    flood = [bench.submit("flooder", seq=seq) for seq in range(50)]
    await bench.waiting(work_queue.QUEUE_DEPTH)
    patient = bench.submit("patient", seq=99)
    await bench.waiting(work_queue.QUEUE_DEPTH + 1)
    order: list[int] = []
    for task in (*flood, patient):
        task.add_done_callback(lambda t: None if t.exception() else order.append(t.result().seq))
    bench.rasterizer.gate.set()
    results = await asyncio.gather(first, patient, *flood, return_exceptions=True)
    superseded = [result for result in results if isinstance(result, Superseded)]
    assert order == [49, 99]
    assert bench.outcome("superseded") == len(superseded) == 49


@pytest.mark.parametrize(
    ("changes", "is_of_use"),
    [
        ({}, False),
        ({"azimuth": 90.0, "profile": 2, "overscan": 0.15, "depth": True, "deadline_ms": 500.0}, False),
        ({"width": 180, "cx": 90.0}, True),
        ({"profile": None}, True),
        ({"format": "png"}, True),
        ({"seq": 3}, True),
    ],
    ids=["the same view", "turned, at another rung", "around", "refined", "another format", "newer"],
)
async def test_an_older_view_is_dropped_once_a_newer_one_begins(
    bench: Bench, changes: dict[str, Any], is_of_use: bool
) -> None:
    first = await busy(bench)
    older = bench.submit("a", **{"seq": 1} | changes)
    await bench.waiting(1)
    newer = bench.submit("a", seq=2)
    await bench.waiting(2)
    bench.rasterizer.gate.set()
    assert (await newer).seq == 2
    if is_of_use:
        assert (await older).body
    else:
        with pytest.raises(Superseded, match="newer view"):
            await older
    await first
    assert len(bench.rasterizer.cameras) == 2 + is_of_use
    assert bench.scenes.users == 0


async def test_nothing_is_dropped_for_a_view_that_is_refused_or_of_another_session(bench: Bench) -> None:
    tasks = [await busy(bench)]
    tasks += [bench.submit("a", seq=1), *(bench.submit("b", seq=seq) for seq in (1, 0, 0))]
    await bench.waiting(4)
    late = bench.submit("a", seq=2, deadline_ms=50)
    await bench.waiting(5)
    bench.now += 1
    bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded):
        await late
    assert all(frame.body for frame in await asyncio.gather(*tasks))


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


async def test_a_request_past_its_deadline_is_shed_and_others_are_not(thread_bench: Bench) -> None:
    first = await busy(thread_bench)
    late, patient = thread_bench.submit("a", deadline_ms=50), thread_bench.submit("b", deadline_ms=5000)
    await thread_bench.waiting(2)
    thread_bench.now += 1
    thread_bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded, match="50 ms"):
        await late
    assert (await patient).timing.queue == 1000
    await first
    assert len(thread_bench.rasterizer.cameras) == 2


async def test_time_counts_from_the_requests_arrival(thread_bench: Bench) -> None:
    """Under load a request also waits for the transport."""
    thread_bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded, match="100 ms"):
        await thread_bench.submit("a", waited=0.2, deadline_ms=100)
    assert thread_bench.rasterizer.cameras == []
    assert (await thread_bench.submit("a", waited=0.2)).timing.queue == 200


async def test_a_frame_that_was_ready_too_late_is_not_sent(bench: Bench) -> None:
    late = bench.submit("a", deadline_ms=100)
    await bench.rendering()
    bench.now += 0.2
    bench.rasterizer.gate.set()
    with pytest.raises(DeadlineExceeded):
        await late
    assert bench.outcome("deadline-exceeded") == 1
    [image] = bench.rasterizer.images
    assert image.closed
    assert image.encoded == (bench.rasterizer.frames_in_flight == 1), "only lanes encode with the device"


async def test_a_huge_frame_is_refused_while_another_client_wants_frames(thread_bench: Bench) -> None:
    huge: dict[str, Any] = {"width": 4096, "height": 4096, "profile": None}
    alone = thread_bench.submit("hostile", **huge)
    await thread_bench.rendering()
    queued = [thread_bench.submit("hostile", **huge) for _ in range(3)]
    await thread_bench.waiting(3)
    polite = thread_bench.submit("polite")
    await thread_bench.waiting(4)
    thread_bench.now += 3
    thread_bench.rasterizer.gate.set()
    assert (await alone).width == 4096
    assert (await polite).width == 320
    for task in queued:
        with pytest.raises(Overloaded, match="4096×4096 pixels"):
            await task
    thread_bench.now += 10
    assert (await thread_bench.submit("hostile", **huge)).width == 4096, "nobody else is there any more"


async def test_an_image_that_nobody_wants_is_not_encoded_but_paid_for(thread_bench: Bench) -> None:
    task = await busy(thread_bench)
    thread_bench.now += 1.0
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    images = thread_bench.rasterizer.images
    thread_bench.rasterizer.gate.set()
    await eventually(lambda: images and images[0].closed)
    assert images[0].encoded == 0
    addresses = thread_bench.engine._queue._schedule._addresses
    await eventually(lambda: addresses._starts["somewhere"] == pytest.approx(1.0))


async def test_a_request_that_cannot_be_ready_in_time_is_shed_but_not_for_ever(thread_bench: Bench) -> None:
    """After a slow first frame, hopeless deadlines are refused; the estimate then fades until one is tried again."""
    first = await busy(thread_bench)
    thread_bench.now += 0.2
    thread_bench.rasterizer.gate.set()
    await first
    outcomes = [
        (await asyncio.gather(thread_bench.submit("a", deadline_ms=100), return_exceptions=True))[0] for _ in range(20)
    ]
    assert isinstance(outcomes[0], DeadlineExceeded)
    assert isinstance(outcomes[-1], Frame), "one slow frame turned every later request away"


async def test_a_rasteriser_that_fails_fails_that_request_alone_and_a_lost_device_is_remembered(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    for _ in range(bench.rasterizer.frames_in_flight + 1):
        bench.rasterizer.error = RuntimeError("out of luck")
        with pytest.raises(RuntimeError):
            await bench.submit("a")
        bench.rasterizer.error = None
        assert (await bench.submit("a")).body
    assert not bench.engine.device_lost.done()
    for _ in range(2):
        bench.rasterizer.error = DeviceLost("gone")
        with pytest.raises(DeviceLost):
            await bench.submit("a")
        assert bench.engine.device_lost.result().detail == "gone"


async def test_an_answer_that_cannot_be_delivered_costs_the_others_nothing(bench: Bench) -> None:
    """Not even frames that wait for their turn while it fails."""
    gone = asyncio.Event()

    def undeliverable(_: object) -> None:
        gone.set()
        raise ValueError("this viewer's connection is broken")

    bench.engine.request(Client("broken", "broken"), render_request(), bench.now, undeliverable)
    await bench.rendering()
    others = [bench.submit(f"client {number}", address=f"{number}") for number in range(4)]
    await bench.waiting(len(others))
    bench.rasterizer.gate.set()
    assert all(frame.body for frame in await asyncio.gather(*others))
    await asyncio.wait_for(gone.wait(), 10)
    assert bench.engine.in_flight == {"loading": 0, "waiting": 0, "rendering": 0}


async def test_a_frame_that_never_ends_means_that_the_device_is_lost(bench: Bench) -> None:
    task = await busy(bench)
    bench.now += STUCK_S
    bench.engine.check_progress()
    assert not bench.engine.device_lost.done()
    bench.now += 0.1
    bench.engine.check_progress()
    assert "the renderer is stuck" in bench.engine.device_lost.result().detail.lower()
    bench.rasterizer.gate.set()
    await task


async def test_wrong_scene_and_rung_are_refused_before_anything_is_queued(bench: Bench) -> None:
    with pytest.raises(UnknownScene):
        await bench.submit("a", scene="../../etc/passwd")
    with pytest.raises(InvalidRequest, match="rungs 0 to 3"):
        await bench.submit("a", profile=4)
    with pytest.raises(InvalidRequest, match="overscan"):
        await bench.submit("a", width=4096, height=4096, profile=None, overscan=0.5)
    assert bench.rasterizer.cameras == []


@pytest.mark.parametrize(
    ("limit", "addresses", "sentence"),
    [("MAX_WAITING", "abc", "Too many requests are waiting"), ("WAITING_PER_ADDRESS", "xxx", "from this address")],
)
async def test_too_many_waiting_requests_are_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, limit: str, addresses: str, sentence: str
) -> None:
    monkeypatch.setattr(work_queue, limit, 3)
    tasks = [await busy(bench)]
    tasks += [bench.submit(f"session {number}", address=address) for number, address in enumerate(addresses)]
    await bench.waiting(3)
    with pytest.raises(Overloaded, match=sentence):
        await bench.submit("one more", address="x")
    if limit == "WAITING_PER_ADDRESS":
        tasks.append(bench.submit("polite", address="elsewhere"))
    bench.rasterizer.gate.set()
    assert all(frame.body for frame in await asyncio.gather(*tasks))


async def test_closing_finishes_what_is_rendered_and_refuses_what_waits() -> None:
    bench = Bench()
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(bench.engine)
        rendered = await busy(bench)
        waiting = bench.submit("a")
        await bench.waiting(1)
        bench.scenes.loading = asyncio.get_running_loop().create_future()
        waiting_for_a_scene = bench.submit("b")
        await asyncio.sleep(0)
        closing = asyncio.create_task(stack.aclose())
        with pytest.raises(Overloaded, match="stopping"):
            await waiting
        bench.rasterizer.gate.set()
        await closing
    with pytest.raises(Overloaded, match="stopping"):
        await waiting_for_a_scene
    assert (await rendered).body
    bench.scenes.loading = None
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
    await eventually(lambda: last() is None)


async def test_a_scene_that_is_loaded_first_holds_up_no_other_request(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    bench.scenes.loading = asyncio.get_running_loop().create_future()
    waiting = [bench.submit(session) for session in "abc"]
    await asyncio.sleep(0)
    waiting[0].cancel()
    bench.scenes.loading.set_result(None)
    assert [(await task).body for task in waiting[1:]] == [b"320x180 jpeg 10"] * 2
    with pytest.raises(asyncio.CancelledError):
        await waiting[0]
    assert bench.outcome("cancelled") == 1
    assert bench.scenes.users == 0


async def test_a_coarse_frame_does_not_wait_for_the_scene_and_a_png_always_does(bench: Bench) -> None:
    bench.rasterizer.gate.set()
    bench.scenes.loading = asyncio.get_running_loop().create_future()
    frame = await bench.submit("a", coarse=True)
    assert (frame.body, frame.coarse) == (b"320x180 jpeg 10", True)
    waiting = [bench.submit("b"), bench.submit("c", coarse=True, format="png")]
    waiting.append(bench.submit("d", coarse=True, detail="full"))
    await bench.idle()
    assert not any(task.done() for task in waiting)
    bench.scenes.loading.set_result(None)
    assert [(await task).coarse for task in waiting] == [False] * 3
    bench.scenes.loading = None
    assert not (await bench.submit("a", coarse=True)).coarse
    assert bench.scenes.users == 0


async def test_the_answer_comes_once_never_at_once_and_not_after_a_withdrawal(bench: Bench) -> None:
    client, answers = Client("somewhere", "a"), list[Frame | Exception]()
    cancel = bench.engine.request(client, render_request(scene="nowhere"), bench.now, answers.append)
    assert answers == []
    await asyncio.sleep(0)
    assert [type(answer) for answer in answers] == [UnknownScene]
    cancel()
    bench.engine.request(client, render_request(scene="nowhere"), bench.now, answers.append)()
    await asyncio.sleep(0)
    assert len(answers) == 1
    assert bench.outcome("cancelled") == 1


async def test_the_engine_tells_how_busy_it_is(bench: Bench) -> None:
    await bench.idle()
    bench.engine.state()
    bench.now += 1
    assert bench.engine.state() == (0.0, 0.0), "nothing was ever asked for"
    first = await busy(bench)
    second = bench.submit("b")
    await bench.waiting(1)
    bench.now += 2
    assert bench.engine.state() == (2.0, 1.0)
    bench.rasterizer.gate.set()
    await asyncio.gather(first, second)
    await bench.idle()
    bench.engine.state()
    bench.now += 2
    assert bench.engine.state() == (0.0, 0.0)


async def test_a_client_that_asks_anew_waits_since_its_first_request(bench: Bench) -> None:
    """Otherwise its late turn would go unnoticed: its first request is never the oldest waiting one."""
    first = await busy(bench)
    waiting = []
    for second in range(8):  # more than may wait, so that the first ones are pushed out
        bench.now = 1000.0 + second
        waiting.append(bench.submit("b", seq=second))
        await bench.waiting(min(second + 1, 4))
        await asyncio.sleep(0)
    age, _ = bench.engine.state()
    assert age == 7.0
    bench.rasterizer.gate.set()
    await asyncio.gather(first, *waiting, return_exceptions=True)
    assert bench.engine.state()[0] == 0.0
