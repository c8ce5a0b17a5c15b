"""Incomplete streams count, and time out."""

from __future__ import annotations

from tigas_render.transport.unfinished import UnfinishedStreams


def test_a_stream_is_late_once_its_time_is_over_however_often_something_arrives() -> None:
    streams = UnfinishedStreams(10.0)
    assert streams.deadline is None
    streams.begin(0, 100.0)
    streams.begin(4, 103.0)
    streams.begin(0, 109.0)
    assert len(streams) == 2
    assert streams.deadline == 110.0
    assert streams.late(109.9) == []
    assert streams.late(110.0) == [0]
    assert streams.late(113.0) == [0, 4]


def test_a_finished_stream_counts_no_more() -> None:
    streams = UnfinishedStreams(10.0)
    streams.begin(0, 100.0)
    streams.end(0)
    streams.end(0)
    assert len(streams) == 0
    assert streams.deadline is None
    streams.begin(0, 200.0)
    assert streams.deadline == 210.0
    streams.clear()
    assert streams.late(300.0) == []
