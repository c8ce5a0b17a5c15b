"""Segments are read while they grow, by any number of readers, and are forgotten in time."""

from __future__ import annotations

import asyncio

import pytest

from tigas_dash.errors import ExpiredSegment, UnknownSegment
from tigas_dash.segments import SegmentWindow

pytestmark = pytest.mark.anyio


async def test_readers_get_each_chunk_as_it_comes_whenever_they_began() -> None:
    window = SegmentWindow(3)
    window.append(1, b"a")
    early = window.read(1)
    assert await anext(early) == b"a"
    waiting = asyncio.ensure_future(anext(early))
    await asyncio.sleep(0)
    assert not waiting.done()
    window.append(1, b"b")
    assert await waiting == b"b"
    late = window.read(1)
    window.append(2, b"c")
    assert [part async for part in late] == [b"ab"]
    assert [part async for part in early] == []


async def test_an_early_request_waits_until_its_segment_begins() -> None:
    window = SegmentWindow(3)
    window.append(1, b"a")
    reader = asyncio.ensure_future(anext(window.read(2)))
    await asyncio.sleep(0)
    window.append(1, b"b")
    await asyncio.sleep(0)
    assert not reader.done()
    window.append(2, b"c")
    assert await reader == b"c"


async def test_old_and_far_segments_are_refused() -> None:
    window = SegmentWindow(2)
    for number in range(1, 7):
        window.append(number, b"x")
    assert await anext(window.read(4)) == b"x"
    with pytest.raises(ExpiredSegment) as expired:
        window.read(3)
    assert expired.value.status == 410
    for number in (0, -1, 9, 10**9):
        with pytest.raises(UnknownSegment):
            window.read(number)


async def test_a_reader_of_a_segment_that_left_the_window_still_gets_the_rest() -> None:
    window = SegmentWindow(1)
    window.append(1, b"a")
    reader = window.read(1)
    assert await anext(reader) == b"a"
    window.append(1, b"b")
    for number in range(2, 9):
        window.append(number, b"x")
    assert [part async for part in reader] == [b"b"]


async def test_the_end_of_the_stream_ends_every_reader() -> None:
    window = SegmentWindow(2)
    window.append(1, b"a")
    readers = [window.read(1), window.read(2)]
    window.close()
    assert [[part async for part in reader] for reader in readers] == [[b"a"], []]
