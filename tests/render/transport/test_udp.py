"""Datagrams leave in batches, arrive unchanged, and survive a full socket or refused batches."""

from __future__ import annotations

import asyncio
import errno
import socket
import time
from typing import Any

import pytest

from tigas_render.transport.udp import BATCHES_AGAIN_S, UdpEndpoint, bind

pytestmark = pytest.mark.anyio


class Socket:
    """A real socket that refuses on demand."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self.full = False
        self.batch_error: int | None = None
        self.small_path: Any = None
        """An address whose path MTU is below a batch's segments; a kernel before 6.14 calls that EINVAL."""
        self.batches = 0
        self.refused = asyncio.Semaphore(0)
        """Released whenever it was full."""

    def sendmsg(self, *arguments: Any) -> int:
        if self.full:
            self.refused.release()
            raise BlockingIOError
        self.batches += 1
        if self.batch_error is not None:
            raise OSError(self.batch_error, "refused")
        if arguments[-1] == self.small_path:
            raise OSError(errno.EINVAL, "Invalid argument")
        return self._sock.sendmsg(*arguments)

    def sendto(self, *arguments: Any) -> int:
        if self.full:
            self.refused.release()
            raise BlockingIOError
        return self._sock.sendto(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sock, name)


class Pair:
    """An endpoint over a socket that a test spoils, and another that it sends to."""

    def __init__(self) -> None:
        self.arrived: list[bytes] = []
        self._news = asyncio.Event()
        self._expected = 0
        self.socket = Socket(bind("127.0.0.1", 0))
        receiver = bind("127.0.0.1", 0)
        self.address = receiver.getsockname()
        self.now = 100.0
        self.refusals: list[float] = []
        self.sender = UdpEndpoint(
            self.socket,  # type: ignore[arg-type]
            lambda *_: None,
            lambda: None,
            lambda: self.refusals.append(self.now),
            lambda: self.now,
        )
        self.receiver = UdpEndpoint(receiver, lambda data, *_: self.arrived.append(data), self._news.set)

    def send(self, *payloads: bytes) -> None:
        self._expected += len(payloads)
        self.sender.send([(payload, self.address) for payload in payloads])

    async def delivered(self) -> list[bytes]:
        async with asyncio.timeout(10):
            while len(self.arrived) < self._expected:
                self._news.clear()
                await self._news.wait()
        return self.arrived

    def close(self) -> None:
        self.sender.close()
        self.receiver.close()


def numbered(count: int, size: int = 1400) -> list[bytes]:
    return [number.to_bytes(2, "big") + bytes(size - 2) for number in range(count)]


async def test_batches_arrive_as_single_datagrams() -> None:
    pair = Pair()
    payloads = [*numbered(90), b"tail"]
    pair.send(*payloads)
    assert await pair.delivered() == payloads
    assert pair.socket.batches == 3
    pair.close()


async def test_a_datagram_arrives_when_the_kernel_gets_it() -> None:
    arrivals: list[float] = []
    news = asyncio.Event()
    receiver = bind("127.0.0.1", 0)
    endpoint = UdpEndpoint(receiver, lambda _, __, arrived: arrivals.append(arrived), news.set)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        async with asyncio.timeout(10):
            while True:  # the kernel begins to stamp only a moment after it was asked to
                news.clear()
                before = time.monotonic()
                sender.sendto(b"x", receiver.getsockname())
                sent = time.monotonic()  # and not read yet
                await news.wait()
                if before <= arrivals[-1] <= sent:
                    break
    endpoint.close()


async def test_a_full_socket_delays_and_loses_nothing() -> None:
    pair = Pair()
    pair.socket.full = True
    payloads = numbered(50)
    pair.send(*payloads[:30])
    pair.send(*payloads[30:])
    async with asyncio.timeout(10):
        for _ in range(3):  # when sending, and when it was tried again
            await pair.socket.refused.acquire()
    pair.socket.full = False
    assert await pair.delivered() == payloads
    pair.close()


@pytest.mark.parametrize("error", [errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT])
async def test_a_kernel_without_offload_gets_single_datagrams(error: int) -> None:
    pair = Pair()
    pair.socket.batch_error = error
    payloads = numbered(20)
    pair.send(*payloads)
    pair.send(*payloads)
    assert await pair.delivered() == [*payloads, *payloads]
    pair.close()


async def test_a_small_path_mtu_spoils_no_other_clients_batches() -> None:
    pair, other = Pair(), Pair()
    pair.socket.small_path = other.address
    payloads = numbered(20)
    for _ in range(2):
        pair.sender.send([(payload, other.address) for payload in payloads])
        pair.send(*payloads)
    other._expected = 40
    assert await other.delivered() == await pair.delivered() == [*payloads, *payloads]
    assert len(pair.refusals) == 1, "the address is spared further batches for a while"
    assert pair.socket.batches == 3, "one refused, two sent"
    pair.now += BATCHES_AGAIN_S
    pair.socket.small_path = None
    pair.sender.send([(payload, other.address) for payload in payloads])
    assert pair.socket.batches == 4, "its path is better now"
    pair.close()
    other.close()


async def test_what_the_network_refuses_is_dropped() -> None:
    pair = Pair()
    pair.sender.send([(bytes(70_000), pair.address)])  # no datagram is that long
    pair.sender.send([(b"x", ("255.255.255.255", 9))])  # broadcast is forbidden
    pair.send(b"after")
    assert await pair.delivered() == [b"after"]
    pair.close()


async def test_closing_twice_does_nothing() -> None:
    pair = Pair()
    pair.close()
    pair.close()
