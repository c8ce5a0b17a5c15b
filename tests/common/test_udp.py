"""Datagrams leave in batches, arrive unchanged and with their times, and survive a full socket or refused batches."""

from __future__ import annotations

import asyncio
import errno
import socket
import struct
import time
from collections.abc import AsyncIterator
from contextlib import closing
from typing import Any

import pytest

from tigas_common.udp import (
    BATCH_RETRY_S,
    MAX_BATCH,
    MAX_SEGMENTS,
    SO_TIMESTAMPNS,
    Address,
    UdpEndpoint,
    arrival_time,
    bind,
    group_datagrams,
    kernel_timestamp_ns,
)

pytestmark = pytest.mark.anyio


class Socket:
    """A real socket that refuses on demand."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self.full = False
        self.batch_error: int | None = None
        self.small_path: Any = None
        """An address with a path MTU below a batch's segments; kernels before 6.14 call that EINVAL."""
        self.batches = 0
        self.refused = asyncio.Semaphore(0)
        """Released whenever it was full."""

    def sendmsg(self, batch: list[bytes], *arguments: Any) -> int:
        self._refuse_if_full()
        if len(batch) == 1:
            return self._sock.sendmsg(batch, *arguments)
        self.batches += 1
        error = errno.EINVAL if arguments[-1] == self.small_path else self.batch_error
        if error is not None:
            raise OSError(error, "refused")
        return self._sock.sendmsg(batch, *arguments)

    def _refuse_if_full(self) -> None:
        if self.full:
            self.refused.release()
            raise BlockingIOError

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


@pytest.fixture
async def pair() -> AsyncIterator[Pair]:
    with closing(Pair()) as pair:
        yield pair


def numbered(count: int, size: int = 1400) -> list[bytes]:
    return [number.to_bytes(2, "big") + bytes(size - 2) for number in range(count)]


async def test_batches_arrive_as_single_datagrams(pair: Pair) -> None:
    payloads = [*numbered(90), b"tail"]
    pair.send(*payloads)
    assert await pair.delivered() == payloads
    assert pair.socket.batches == 3


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


@pytest.mark.parametrize("ours", ["0.0.0.0", "::"])
async def test_answers_leave_from_the_address_that_was_written_to(ours: str) -> None:
    def answer(data: bytes, address: Address, _arrived: float) -> None:
        endpoint.send([(data, address)] * 2 + [(data * 2, address)])  # a batch, and one by itself

    sock = bind(ours, 0)
    endpoint = UdpEndpoint(sock, answer, lambda: None)
    with closing(endpoint), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        client.connect(("127.0.0.7", sock.getsockname()[1]))  # and hears no other address
        client.send(b"x")
        async with asyncio.timeout(10):
            assert [await asyncio.get_running_loop().sock_recv(client, 9) for _ in range(3)] == [b"x", b"x", b"xx"]


async def test_a_full_socket_delays_and_loses_nothing(pair: Pair) -> None:
    pair.socket.full = True
    payloads = numbered(50)
    pair.send(*payloads[:30])
    pair.send(*payloads[30:])
    async with asyncio.timeout(10):
        for _ in range(3):  # when sending, and when it was tried again
            await pair.socket.refused.acquire()
    pair.socket.full = False
    assert await pair.delivered() == payloads


@pytest.mark.parametrize("error", [errno.EINVAL, errno.EIO, errno.EMSGSIZE, errno.ENOPROTOOPT])
async def test_a_kernel_without_offload_gets_single_datagrams(pair: Pair, error: int) -> None:
    pair.socket.batch_error = error
    payloads = numbered(20)
    pair.send(*payloads)
    pair.send(*payloads)
    assert await pair.delivered() == [*payloads, *payloads]


async def test_a_small_path_mtu_spoils_no_other_clients_batches(pair: Pair) -> None:
    other = Pair()
    pair.socket.small_path = other.address
    payloads = numbered(20)
    for _ in range(2):
        pair.sender.send([(payload, other.address) for payload in payloads])
        pair.send(*payloads)
    other._expected = 40
    assert await other.delivered() == await pair.delivered() == [*payloads, *payloads]
    assert len(pair.refusals) == 1, "the address is spared further batches for a while"
    assert pair.socket.batches == 3, "one refused, two sent"
    pair.now += BATCH_RETRY_S
    pair.socket.small_path = None
    pair.sender.send([(payload, other.address) for payload in payloads])
    assert pair.socket.batches == 4, "its path is better now"
    other.close()


async def test_what_the_network_refuses_is_dropped(pair: Pair) -> None:
    pair.sender.send([(bytes(70_000), pair.address)])  # no datagram is that long
    pair.sender.send([(b"x", ("255.255.255.255", 9))])  # broadcast is forbidden
    pair.send(b"after")
    assert await pair.delivered() == [b"after"]


async def test_closing_twice_does_nothing(pair: Pair) -> None:
    pair.close()


A, B = ("192.0.2.1", 1), ("192.0.2.1", 2)


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ([], []),
        ([100], [[100]]),
        ([1452] * 3, [[1452] * 3]),
        ([1452, 1452, 30, 1452], [[1452, 1452, 30], [1452]]),
        ([30, 1452, 1452], [[30], [1452, 1452]]),
        ([100] * (MAX_SEGMENTS + 1), [[100] * MAX_SEGMENTS, [100]]),
        ([MAX_BATCH // 4] * 5, [[MAX_BATCH // 4] * 4, [MAX_BATCH // 4]]),
    ],
)
def test_a_batch_has_one_size_but_for_its_last(sizes: list[int], expected: list[list[int]]) -> None:
    result = list(group_datagrams([(bytes(size), A) for size in sizes]))
    assert [[len(data) for data in batch] for batch, _ in result] == expected


def test_a_batch_has_one_address() -> None:
    result = list(group_datagrams([(b"1", A), (b"2", B), (b"3", B), (b"4", A)]))
    assert result == [([b"1"], A), ([b"2", b"3"], B), ([b"4"], A)]


REAL = 1_800_000_000_000_000_000


@pytest.mark.parametrize(
    ("stamp", "arrived"),
    [
        (REAL - 2_300_000_000, 997.7),
        (REAL, 1000.0),
        (None, 1000.0),
        (REAL + 3_600_000_000_000, 1000.0),
        (REAL - 3_600_000_000_000, 990.0),
    ],
    ids=["it waited", "it did not", "no stamp", "the clock was set back", "the clock was set forward"],
)
def test_when_a_datagram_arrived(stamp: int | None, arrived: float) -> None:
    assert arrival_time(stamp, REAL, now=1000.0, empty_at=990.0) == pytest.approx(arrived)


def test_the_stamp_is_found_among_other_messages() -> None:
    stamp = (socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 12, 34))
    assert kernel_timestamp_ns([(socket.IPPROTO_IP, 1, b"other"), stamp]) == 12_000_000_034
