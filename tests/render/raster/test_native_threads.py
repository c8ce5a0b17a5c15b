"""Threads that make C calls while Python goes on."""

from __future__ import annotations

import ctypes
import os
import select
from collections.abc import Iterator
from typing import Any

import pytest

from tigas_render.raster.native_threads import Call, CallError, Calls, NativeThreads, Stopwatch

LIBC: Any = ctypes.CDLL(None)
NO_SUCH = Call(LIBC.close, (-1,))
"""Gives -1."""


@pytest.fixture
def threads() -> Iterator[NativeThreads]:
    threads = NativeThreads(2, lambda: None)
    yield threads
    threads.end()
    threads.close()


def wait(threads: NativeThreads) -> list[int]:
    """The threads that are done next."""
    assert select.select([threads], [], [], 10)[0]
    return threads.ended()


def test_calls_are_made_in_order_and_told_of(threads: NativeThreads) -> None:
    to = ctypes.create_string_buffer(3)
    letters = [ctypes.create_string_buffer(text) for text in (b"a", b"ab")]
    first, second = (Calls(Call(LIBC.strcpy, (ctypes.addressof(to), ctypes.addressof(text)))) for text in letters)
    assert threads.ended() == []
    failing = Calls(NO_SUCH)
    threads.begin(0, failing, first)  # strcpy returns an address, so it counts as failed as well
    threads.begin(1, second)
    ended: list[int] = []
    while len(ended) < 2:
        ended += wait(threads)
    assert sorted(ended) == [0, 1]
    assert to.value == b"ab", "nothing was made after the call that failed"


def test_a_failure_is_that_of_its_call(threads: NativeThreads) -> None:
    class Refused(CallError):
        pass

    good = Calls(Call(LIBC.sched_yield, ()))
    threads.begin(1, good, Calls(Call(LIBC.sched_yield, ()), Call(LIBC.close, (-1,), Refused)))
    assert wait(threads) == [1]
    with pytest.raises(Refused, match=r"^close failed with status -1$"):
        threads.check(1)
    threads.begin(1, good)
    assert wait(threads) == [1]
    threads.check(1)


def test_python_and_other_threads_go_on_meanwhile_and_the_end_waits(threads: NativeThreads) -> None:
    counter = ctypes.create_string_buffer(8)
    event = os.eventfd(0)
    waiting = Calls(Call(LIBC.eventfd_read, (event, ctypes.addressof(counter))))
    threads.begin(0, waiting)
    threads.begin(1, Calls(Call(LIBC.sched_yield, ())))
    assert wait(threads) == [1], "the other one waits"
    os.eventfd_write(event, 7)
    threads.end()
    assert threads.ended() == [0]
    threads.check(0)
    assert counter.raw[0] == 7
    with pytest.raises(RuntimeError):
        threads.begin(0, waiting)
    os.close(event)


def test_each_thread_is_entered_once(threads: NativeThreads) -> None:
    entered: list[int] = []
    more = NativeThreads(3, lambda: entered.append(1))
    more.end()
    more.close()
    assert entered == [1, 1, 1]


def test_a_stopwatch_takes_the_time_between_calls() -> None:
    watch = Stopwatch(3)
    began, between, ended = watch.readings
    began.make()
    Calls(Call(LIBC.usleep, (2000,))).make()
    between.make()
    ended.make()
    asleep, awake = watch.seconds()
    assert asleep >= 0.002
    assert 0 <= awake < asleep + 1
