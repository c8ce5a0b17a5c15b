"""A stream of messages comes out as it went in, however it was cut."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tigas_render.pipe.framing import BadMessage, Kind, Splitter, framed


@given(st.lists(st.tuples(st.sampled_from(Kind), st.binary(max_size=40))), st.data())
def test_messages_come_out_whole_and_in_order_wherever_the_stream_is_cut(
    messages: list[tuple[Kind, bytes]], data: st.DataObject
) -> None:
    stream = b"".join(framed(kind, content) for kind, content in messages)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    splitter = Splitter()
    found = [
        message
        for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)
        for message in splitter.feed(stream[begin:end])
    ]
    assert found == messages


def test_a_message_that_is_too_long_is_refused_before_it_is_there() -> None:
    splitter = Splitter(100)
    assert list(splitter.feed(framed(Kind.STATS, bytes(100)))) == [(Kind.STATS, bytes(100))]
    with pytest.raises(BadMessage, match="101 bytes is too long"):
        list(splitter.feed(framed(Kind.STATS, bytes(101))[:5]))
