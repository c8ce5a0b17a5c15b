"""A viewer's socket: batches are split, and dropped datagrams are counted."""

from __future__ import annotations

import socket
import time

import pytest

from benchmarks.load import udp
from benchmarks.load.udp import ViewerSocket
from tigas_render.transport.udp import segment_size


@pytest.fixture
def server() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    return sock


def test_batches_come_apart_again(server: socket.socket) -> None:
    viewer = ViewerSocket(server.getsockname(), "127.1.0.9")
    viewer.send(b"hello")
    data, address = server.recvfrom(100)
    assert (data, address[0]) == (b"hello", "127.1.0.9")
    parts = [bytes([number]) * 1000 for number in range(5)] + [b"rest"]
    server.sendmsg(parts, segment_size(parts), 0, address)
    server.sendto(b"alone", address)
    before = time.monotonic()
    read = list(viewer.read())
    assert [data for data, _ in read] == [*parts, b"alone"]
    assert all(before - 1 < arrived <= time.monotonic() for _, arrived in read)
    assert viewer.dropped == 0
    viewer.close()
    server.close()


def test_what_there_was_no_room_for_is_counted(server: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "BUFFER", 20_000)
    viewer = ViewerSocket(server.getsockname(), None)
    viewer.send(b"hello")
    _, address = server.recvfrom(100)
    for _ in range(200):
        server.sendto(bytes(1000), address)
    first = len(list(viewer.read()))
    assert 0 < first < 200
    server.sendto(b"one more", address)
    list(viewer.read())
    while list(viewer.read()):
        pass
    assert viewer.dropped >= 100
    viewer.close()
    server.close()


def test_a_closed_port_is_noticed(server: socket.socket) -> None:
    viewer = ViewerSocket(server.getsockname(), None)
    server.close()
    viewer.send(b"hello")
    with pytest.raises(ConnectionError):
        list(viewer.read())
    viewer.close()
