"""Messages reach the other end in few writes, since each write wakes it."""

from __future__ import annotations

import asyncio

import pytest

from tests.render.pipe.pipe_bench import until
from tigas_render.pipe.link import Link

pytestmark = pytest.mark.anyio


class Recorder(asyncio.Transport):
    """Records writes."""

    def __init__(self) -> None:
        self.writes: list[bytes] = []
        self.closed = False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.writes.append(bytes(data))

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return self.closed


class End(Link):
    """Ignores messages."""

    def received(self, kind: int, content: bytes) -> None:
        raise NotImplementedError


async def test_a_turns_messages_leave_together_and_take_along_what_can_wait() -> None:
    end, recorder = End(100), Recorder()
    end.connection_made(recorder)
    end.send_with_next(b"1")
    await asyncio.sleep(0)
    assert recorder.writes == []
    end.send_with_next(b"2")
    end.send(b"3")
    end.send(b"4")
    end.send_with_next(b"5")
    await asyncio.sleep(0)
    assert recorder.writes == [b"12345"]
    await asyncio.sleep(0)
    end.send_with_next(b"6")
    await until(lambda: recorder.writes == [b"12345", b"6"])
    assert end.unsent == 0


async def test_nothing_leaves_once_the_pipe_is_closed() -> None:
    end, recorder = End(100), Recorder()
    end.connection_made(recorder)
    end.send_with_next(b"1")
    recorder.closed = True
    end.send(b"2")
    end.send_with_next(b"3")
    await until(lambda: not end._is_delayed)
    assert recorder.writes == []
