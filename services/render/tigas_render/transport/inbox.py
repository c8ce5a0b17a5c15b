"""Received datagrams waiting to be handled. Addresses share the event loop's time equally, however much they send."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

from tigas_common.address import client_network
from tigas_common.udp import Address
from tigas_render.fair_queue import FairQueue

MAX_WAITING = 512
"""Maximum number of waiting datagrams per address; further ones are dropped, which QUIC treats as loss."""
EXPECTED_S = 0.0001
"""Assumed handling time of a datagram before it is measured, in seconds."""


class ReceivedDatagram(NamedTuple):
    """A received datagram."""

    data: bytes
    address: Address
    arrived: float
    """Time of arrival in seconds of the monotonic clock."""


class Inbox:
    """A fair queue of datagrams; a plain FIFO would favour the heaviest sender."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[ReceivedDatagram]] = {}
        """Waiting datagrams by network, without empty queues."""
        self._queue = FairQueue()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, data: bytes, address: Address, arrived: float) -> None:
        """Keep a datagram until its sender's turn."""
        network = client_network(str(address[0]))
        if network not in self._waiting:
            self._waiting[network] = deque()
            self._queue.add(network, EXPECTED_S)
        if len(self._waiting[network]) < MAX_WAITING:
            self._waiting[network].append(ReceivedDatagram(data, address, arrived))

    def pop(self, excluded: Collection[str] = ()) -> tuple[str, ReceivedDatagram] | None:
        """Take the oldest datagram of the next address that is not in `excluded`; None if no datagram is left."""
        network = self._queue.peek(excluded)
        if network is None:
            return None
        self._queue.start_turn(network, EXPECTED_S)
        datagram = self._waiting[network].popleft()
        if not self._waiting[network]:
            del self._waiting[network]
            self._queue.remove(network)
        return network, datagram

    def count(self, network: str) -> int:
        return len(self._waiting.get(network, ()))

    def charge(self, network: str, seconds: float) -> None:
        """Record how long it took to handle an address's last datagram, in seconds."""
        self._queue.charge(network, seconds - EXPECTED_S)
