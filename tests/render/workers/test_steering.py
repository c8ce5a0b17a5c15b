"""The kernel's side of it, with bare sockets."""

from __future__ import annotations

import os
import random
import socket
from contextlib import ExitStack

import pytest

from tigas_render.transport.cids import Edge
from tigas_render.transport.steering import steer
from tigas_render.transport.udp import bind_all, bind_another


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "::"])
@pytest.mark.parametrize("edges", [2, 5])
def test_every_datagram_comes_to_the_socket_that_it_names(edges: int, host: str) -> None:
    with ExitStack() as stack:
        [first] = map(stack.enter_context, bind_all(host, 0))
        sockets = [first, *(stack.enter_context(bind_another(first)) for _ in range(edges - 1))]
        assert steer(first, edges)
        family = first.family
        target = (host if host != "::" else "::1", first.getsockname()[1])
        for _ in range(200):
            number = random.randrange(edges)
            cid = Edge(number, edges).named(os.urandom(8))
            header = random.choice((b"\xc3\x00\x00\x00\x01\x08", b"\x41"))
            with socket.socket(family, socket.SOCK_DGRAM) as client:  # each from a different port
                client.sendto(header + cid + b"rest", target)
            sockets[number].settimeout(2)
            assert sockets[number].recv(100) == header + cid + b"rest"
            sockets[number].settimeout(0)


def test_a_port_that_is_shared_cannot_be_bound_by_another_service() -> None:
    with ExitStack() as stack:
        [first] = map(stack.enter_context, bind_all("127.0.0.1", 0))
        stack.enter_context(bind_another(first))
        with pytest.raises(OSError, match="in use"):
            bind_all("127.0.0.1", first.getsockname()[1])
