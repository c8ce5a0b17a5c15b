"""A stream of messages comes out as it went in, however it was cut, and reaches the other end in few writes."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.eventually import eventually
from tigas_render.pipe.link import Kind, Link, MessageDecoder, encode_message

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

    def handle_message(self, kind: int, values: tuple[Any, ...]) -> None:
        raise NotImplementedError


async def test_a_turns_messages_leave_together_and_take_along_what_can_wait() -> None:
    end, recorder = End(), Recorder()
    end.connection_made(recorder)
    end.send_lazily(b"1")
    await asyncio.sleep(0)
    assert recorder.writes == []
    end.send_lazily(b"2")
    end.send(b"3")
    end.send(b"4")
    end.send_lazily(b"5")
    await asyncio.sleep(0)
    assert recorder.writes == [b"12345"]
    await asyncio.sleep(0)
    end.send_lazily(b"6")
    await eventually(lambda: recorder.writes == [b"12345", b"6"])
    assert end.unsent_bytes == 0


async def test_nothing_leaves_once_the_pipe_is_closed() -> None:
    end, recorder = End(), Recorder()
    end.connection_made(recorder)
    end.send_lazily(b"1")
    recorder.closed = True
    end.send(b"2")
    end.send_lazily(b"3")
    await eventually(lambda: not end._is_flush_delayed)
    assert recorder.writes == []


@given(st.lists(st.tuples(st.sampled_from(Kind), st.tuples(st.binary(max_size=40), st.integers()))), st.data())
def test_messages_come_out_whole_and_in_order_wherever_the_stream_is_cut(
    messages: list[tuple[Kind, tuple[bytes, int]]], data: st.DataObject
) -> None:
    stream = b"".join(encode_message(kind, *values) for kind, values in messages)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    decoder = MessageDecoder()
    found = [
        message
        for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)
        for message in decoder.feed(stream[begin:end])
    ]
    assert found == messages
