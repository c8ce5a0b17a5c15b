"""Calls from threads reach the event loop once, in order, with few wakeups."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

import pytest

from tests.eventually import eventually
from tigas_render.engine.work import CallbackQueue

pytestmark = pytest.mark.anyio


def put(queue: CallbackQueue[int], count: int) -> threading.Thread:
    """Put numbers on a thread, which has started."""

    def put_all() -> None:
        for number in range(count):
            queue.put(number)

    thread = threading.Thread(target=put_all)
    thread.start()
    return thread


async def test_all_that_comes_while_the_loop_is_busy_comes_at_one_wakeup(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, received, wakeups = asyncio.get_running_loop(), list[int](), list[object]()
    call_soon = loop.call_soon_threadsafe

    def wake(call: Callable[[], None]) -> None:
        wakeups.append(call)
        call_soon(call)

    monkeypatch.setattr(loop, "call_soon_threadsafe", wake)
    queue = CallbackQueue(received.append)
    put(queue, 100).join()
    assert received == []
    await asyncio.sleep(0)
    assert received == list(range(100))
    assert len(wakeups) == 1
    queue.put(100)
    await asyncio.sleep(0)
    assert received[-1] == 100


async def test_nothing_is_lost_between_threads() -> None:
    received: list[int] = []
    queue = CallbackQueue(received.append)
    for _ in range(3):
        put(queue, 2000)
    await eventually(lambda: len(received) == 6000)
    assert sorted(received) == sorted([*range(2000)] * 3)


async def test_one_that_cannot_be_received_does_not_keep_the_others(caplog: pytest.LogCaptureFixture) -> None:
    received: list[float] = []
    queue: CallbackQueue[int] = CallbackQueue(lambda number: received.append(1 / number))
    for number in (1, 0, 2):
        queue.put(number)
    queue.deliver()
    assert received == [1, 0.5]
    assert "ZeroDivisionError" in caplog.text
