from __future__ import annotations

import os

import pytest

from tigas_render.transport.cids import Edge

LONG, SHORT = b"\xc3\x00\x00\x00\x01\x08", b"\x41"


@pytest.mark.parametrize("edges", [1, 2, 3, 6, 8])
def test_every_id_names_its_edge_in_both_kinds_of_header(edges: int) -> None:
    for number in range(edges):
        edge, elsewhere = Edge(number, edges), Edge((number + 1) % edges, edges)
        for first in range(256):
            cid = edge.named(bytes((first,)) + os.urandom(7))
            assert len(cid) == 8
            for header in (LONG, SHORT):
                assert edge.owner(header + cid) == elsewhere.owner(header + cid) == number
            assert edge.named(cid) == cid


def test_what_names_no_edge_is_kept_where_it_is() -> None:
    for datagram in (b"", b"\x41", b"\xc3\x00\x00\x00\x01"):
        assert Edge(2, 3).owner(datagram) == 2
