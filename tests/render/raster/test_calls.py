"""C functions called in order, without the interpreter's lock."""

from __future__ import annotations

import ctypes
import os
import threading
from typing import Any, cast

import pytest

from tigas_render.raster.calls import MAX_ARGUMENTS, Call, CallError, Calls

FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int64] * MAX_ARGUMENTS)


class Recorder:
    """A C function that remembers how it was called."""

    def __init__(self, name: str, status: int = 0) -> None:
        self.seen: list[tuple[int, ...]] = []
        self.status = status
        self.function = cast(Any, FUNCTION(self._called))
        self.function.__name__ = name

    def _called(self, *arguments: int) -> int:
        self.seen.append(arguments)
        return self.status


def test_all_arguments_arrive_in_order() -> None:
    recorder = Recorder("record")
    numbers = tuple(range(1 << 40, (1 << 40) + MAX_ARGUMENTS))
    Calls(Call(recorder.function, numbers)).make()
    assert recorder.seen == [numbers]


def test_the_first_failure_is_told_and_ends_it() -> None:
    class Refused(CallError):
        pass

    good, bad, never = Recorder("good"), Recorder("bad", 7), Recorder("never")
    with pytest.raises(Refused, match=r"^bad failed with status 7$") as raised:
        Calls(Call(good.function, ()), Call(bad.function, (), Refused), Call(never.function, ())).make()
    assert raised.value.status == 7
    assert len(good.seen) == 1
    assert not never.seen


def test_other_threads_go_on_meanwhile() -> None:
    reader, writer = os.pipe()
    room = ctypes.create_string_buffer(1)
    read = Call(ctypes.CDLL(None).read, (reader, ctypes.addressof(room), 1))  # waits until something was written
    other = threading.Timer(0.05, os.write, (writer, b"!"))
    other.start()
    with pytest.raises(CallError, match="status 1"):  # one byte
        Calls(read).make()
    other.join()
    assert room.raw == b"!"
    os.close(reader)
    os.close(writer)
