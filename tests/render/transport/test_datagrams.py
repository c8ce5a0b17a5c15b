"""A frame's fragments carry it whole, in datagrams that fit."""

from __future__ import annotations

from typing import Any, cast

import pytest

from tigas_common.errors import InvalidRequest
from tigas_render.admission.limits import Limits
from tigas_render.transport.datagrams import FRAGMENT_HEADER, Datagrams, fragments
from tigas_render.transport.outlet import Writer


@pytest.mark.parametrize(("length", "count"), [(0, 1), (1, 1), (100, 1), (101, 2), (200, 2), (250, 3)])
def test_fragments_carry_everything(length: int, count: int) -> None:
    answer = bytes(range(length))
    pieces = fragments(7, answer, max_datagram=100 + FRAGMENT_HEADER.size)
    assert [FRAGMENT_HEADER.unpack_from(piece) for piece in pieces] == [(7, n, count) for n in range(count)]
    assert b"".join(piece[FRAGMENT_HEADER.size :] for piece in pieces) == answer
    assert all(len(piece) == 108 for piece in pieces[:-1])


def test_too_many_fragments_are_refused() -> None:
    assert len(fragments(0, bytes(65_535), max_datagram=9)) == 65_535
    with pytest.raises(InvalidRequest, match="65,535"):
        fragments(0, bytes(65_536), max_datagram=9)


class Network:
    """The part of a connection used by an outlet; it takes as many datagrams as a test allows."""

    max_datagram_payload = 116

    def __init__(self) -> None:
        self.datagram_room = 0
        self.sent: list[tuple[int, ...]] = []

    def send_datagram_frame(self, data: bytes) -> None:
        self.datagram_room -= 1
        self.sent.append(FRAGMENT_HEADER.unpack_from(data, 1))


class Session:
    """A session with the id 0 on such a network."""

    def __init__(self) -> None:
        self.network = Network()
        self.writer = Writer(cast(Any, self.network), cast(Any, None), Limits(), lambda: None)
        self.datagrams = Datagrams(self.writer, 0)

    def sends(self, room: int) -> list[tuple[int, ...]]:
        """Datagrams sent with this much room: seq, fragment and number of fragments of each."""
        self.network.datagram_room, self.network.sent = room, []
        self.writer.hand_over_datagrams()
        return self.network.sent


def test_only_the_newest_frame_waits() -> None:
    session = Session()
    first, second, third = (session.datagrams.next_request() for _ in range(3))
    session.datagrams.send_frame(first, 1, bytes(1000))
    assert session.sends(room=1) == [(1, 0, 10)]
    session.datagrams.send_frame(third, 3, bytes(150))
    session.datagrams.send_frame(second, 2, bytes(150))  # an older frame that is ready later is not sent at all
    assert session.sends(room=9) == [(3, 0, 2), (3, 1, 2)], "the rest of the older frame is dropped"


def test_a_problem_goes_first_and_drops_no_frame() -> None:
    session = Session()
    session.datagrams.send_frame(session.datagrams.next_request(), 1, bytes(150))
    session.datagrams.send_problem(2, bytes(50))
    assert session.sends(room=9) == [(2, 0, 1), (1, 0, 2), (1, 1, 2)]


def test_what_the_path_no_longer_carries_holds_up_nothing() -> None:
    session = Session()
    session.datagrams.send_frame(session.datagrams.next_request(), 1, bytes(150))
    session.network.max_datagram_payload = 60
    session.datagrams.send_problem(2, bytes(40))
    assert session.sends(room=9) == [(2, 0, 1), (1, 1, 2)]
