"""A frame's fragments carry it whole, in datagrams that fit."""

from __future__ import annotations

from collections import deque
from typing import Any, cast

import pytest

from tigas_render.transport.datagrams import FRAGMENT_HEADER, DatagramSender, fragments


@pytest.mark.parametrize(("length", "count"), [(0, 1), (1, 1), (100, 1), (101, 2), (200, 2), (250, 3)])
def test_fragments_carry_everything(length: int, count: int) -> None:
    answer = bytes(range(length))
    pieces = fragments(7, answer, max_datagram=100 + FRAGMENT_HEADER.size)
    assert [FRAGMENT_HEADER.unpack_from(piece) for piece in pieces] == [(7, n, count) for n in range(count)]
    assert b"".join(piece[FRAGMENT_HEADER.size :] for piece in pieces) == answer
    assert all(len(piece) == 108 for piece in pieces[:-1])


def test_too_many_fragments_are_refused() -> None:
    assert len(fragments(0, bytes(65_535), max_datagram=9)) == 65_535
    with pytest.raises(ValueError, match="65535"):
        fragments(0, bytes(65_536), max_datagram=9)


class Session:
    """What a sender uses of a session; the network is full, so everything waits."""

    max_datagram = 108

    def __init__(self) -> None:
        self.outgoing: deque[bytes] = deque()
        self.urgent: deque[bytes] = deque()

    def flush(self) -> None:
        pass

    def waiting(self) -> list[tuple[int, ...]]:
        return [FRAGMENT_HEADER.unpack_from(piece) for piece in (*self.urgent, *self.outgoing)]


def test_only_the_newest_frame_waits() -> None:
    session = Session()
    sender = DatagramSender(cast(Any, session))
    first, second, third = (sender.next_turn() for _ in range(3))
    sender.send_frame(first, 1, bytes(1000))
    session.outgoing.popleft()  # its first fragment is on its way
    sender.send_frame(third, 3, bytes(150))
    assert session.waiting() == [(3, 0, 2), (3, 1, 2)], "the rest of the older frame is dropped"
    sender.send_frame(second, 2, bytes(150))
    assert session.waiting() == [(3, 0, 2), (3, 1, 2)], "an older frame that is ready later is not sent at all"


def test_a_problem_goes_first_and_drops_no_frame() -> None:
    session = Session()
    sender = DatagramSender(cast(Any, session))
    sender.send_frame(sender.next_turn(), 1, bytes(150))
    sender.send_problem(2, bytes(50))
    assert session.waiting() == [(2, 0, 1), (1, 0, 2), (1, 1, 2)]
