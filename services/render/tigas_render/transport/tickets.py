"""Session tickets, so that a client that comes back sends its first request with its first packet (0-RTT)."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

from aioquic.tls import SessionTicket

MAX_TICKETS = 1024


class TicketStore:
    """The newest tickets, each good for one resumption, so that a recorded first flight cannot be played again."""

    def __init__(self, capacity: int = MAX_TICKETS) -> None:
        self._capacity = capacity
        self._tickets: OrderedDict[bytes, SessionTicket] = OrderedDict()

    def __len__(self) -> int:
        return len(self._tickets)

    def __iter__(self) -> Iterator[SessionTicket]:
        return iter(self._tickets.values())

    def add(self, ticket: SessionTicket) -> None:
        """Keep a ticket that was issued; the oldest makes room."""
        self._tickets[ticket.ticket] = ticket
        while len(self._tickets) > self._capacity:
            self._tickets.popitem(last=False)

    def take(self, label: bytes) -> SessionTicket | None:
        """The ticket that a client presents, once."""
        return self._tickets.pop(label, None)
