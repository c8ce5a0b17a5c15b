"""One edge's share of the common port."""

from __future__ import annotations

import socket
from dataclasses import dataclass

from tigas_render.transport.cids import ALONE, Edge
from tigas_render.transport.relay import Relay
from tigas_render.transport.tickets import TicketStore


@dataclass(frozen=True, slots=True)
class Share:
    """By default the whole port."""

    edge: Edge = ALONE
    sockets: tuple[socket.socket, ...] = ()
    """Bound, and the edge's to close: one, or one for each of two families. Without any, the server binds its own."""
    retry_key: bytes | None = None
    """The same for all edges, so that each takes the others' tokens."""
    tickets: TicketStore | None = None
    """Session tickets of all edges."""
    relay: Relay | None = None
    """Where the kernel does not bring each datagram to the edge that it is for."""
