"""Session tickets that every edge knows, so that a client's first packet resumes its session wherever it comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from aioquic.tls import SessionTicket

from tigas_render.fleet.control import TicketIssued, TicketTaken
from tigas_render.transport.tickets import TicketStore


class SharedTickets(TicketStore):
    """One edge's copy. A ticket that two edges take within a millisecond is taken twice; early data is idempotent."""

    def __init__(self, tell: Callable[[TicketIssued | TicketTaken], None]) -> None:
        """tell: brings it to the other edges."""
        super().__init__()
        self._tell = tell

    def add(self, ticket: SessionTicket) -> None:
        super().add(ticket)
        # aioquic leaves out the name of a server, which only clients need
        self._tell(TicketIssued(ticket=replace(ticket, server_name=ticket.server_name or "")))

    def take(self, label: bytes) -> SessionTicket | None:
        ticket = super().take(label)
        if ticket is not None:
            self._tell(TicketTaken(label=label))
        return ticket

    def heard(self, message: TicketIssued | TicketTaken) -> None:
        """Take note of what another edge did."""
        if isinstance(message, TicketIssued):
            super().add(message.ticket)
        else:
            super().take(message.label)
