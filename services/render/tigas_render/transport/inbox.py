"""Received datagrams waiting to be handled: addresses share the event loop's time equally, whatever they send."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

from tigas_common.address import client_network
from tigas_common.udp import Address
from tigas_render.fair_queue import Turns

MAX_WAITING = 512
"""Datagrams of one address that wait; further ones are dropped, which QUIC sees as loss."""
EXPECTED_S = 0.0001
"""Assumed handling time of a datagram before it is measured, in seconds."""


class Received(NamedTuple):
    """A datagram."""

    data: bytes
    address: Address
    arrived: float
    """Seconds of the monotonic clock."""


class Inbox:
    """A plain FIFO would favour the heaviest sender."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Received]] = {}
        """By network; none is empty."""
        self._turns = Turns()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, data: bytes, address: Address, arrived: float) -> None:
        """Keep a datagram until it is its sender's turn."""
        network = client_network(str(address[0]))
        if network not in self._waiting:
            self._waiting[network] = deque()
            self._turns.join(network, EXPECTED_S)
        if len(self._waiting[network]) < MAX_WAITING:
            self._waiting[network].append(Received(data, address, arrived))

    def take(self, besides: Collection[str] = ()) -> tuple[str, Received] | None:
        """The oldest datagram of the next address in turn, except those in `besides`; None if nothing waits."""
        network = self._turns.next(besides)
        if network is None:
            return None
        self._turns.begin(network, EXPECTED_S)
        datagram = self._waiting[network].popleft()
        if not self._waiting[network]:
            del self._waiting[network]
            self._turns.leave(network)
        return network, datagram

    def waiting(self, network: str) -> int:
        return len(self._waiting.get(network, ()))

    def settle(self, network: str, seconds: float) -> None:
        """Record the handling time of the last datagram of an address."""
        self._turns.settle(network, seconds - EXPECTED_S)
