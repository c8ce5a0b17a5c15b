"""A frame's fragments carry it whole, in datagrams that fit."""

from __future__ import annotations

import pytest

from tigas_render.transport.datagrams import FRAGMENT_HEADER, fragments


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
