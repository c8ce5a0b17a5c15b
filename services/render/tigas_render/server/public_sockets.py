"""All public sockets of the service. The supervisor keeps them open, so that an edge can exit without losing packets.

A restarted edge gets the same sockets: the kernel steers packets by a socket's number within the port, which is fixed.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from tigas_common.address import Address
from tigas_common.errors import StartError
from tigas_common.limits import HttpLimits
from tigas_common.runner import listen_errors
from tigas_common.udp import bind_all, bind_shared
from tigas_render.settings import RenderSettings
from tigas_render.transport.shared_port import attach_steering


@dataclass(frozen=True, slots=True)
class PublicSockets:
    """Bound sockets; the TCP ones are listening."""

    http: socket.socket
    https: socket.socket | None
    quic: tuple[tuple[socket.socket, ...], ...]
    """The sockets of each edge, one for each address family; empty if QUIC is off."""

    @property
    def http_port(self) -> int:
        return int(self.http.getsockname()[1])

    @property
    def https_port(self) -> int | None:
        return None if self.https is None else int(self.https.getsockname()[1])

    @property
    def quic_port(self) -> int | None:
        return int(self.quic[0][0].getsockname()[1]) if self.quic else None

    def file_descriptors(self) -> tuple[int, ...]:
        """The file descriptors of all sockets; every edge inherits all of them."""
        tcp = (self.http,) if self.https is None else (self.http, self.https)
        groups = (tcp, *self.quic)
        return tuple(sock.fileno() for group in groups for sock in group)

    @classmethod
    @contextmanager
    def open(cls, settings: RenderSettings, edges: int) -> Iterator[PublicSockets]:
        """Open the sockets, as a context manager. Raises StartError for an unusable address."""
        with ExitStack() as stack:
            quic: tuple[tuple[socket.socket, ...], ...] = ()
            if settings.quic is not None:
                with listen_errors(settings.quic, "--quic"):
                    families = [
                        _bind_edges(first, edges, stack) for first in bind_all(settings.quic.host, settings.quic.port)
                    ]
                quic = tuple(zip(*families, strict=True))
                if edges > 1 and not all(attach_steering(family[0], edges) for family in families):
                    raise StartError("This kernel cannot share a port among edges; start the service with --edges 1.")
            https = None if settings.https is None else _listen(settings.https, "--https", settings, stack)
            http = _listen(settings.http, "--http", settings, stack)
            yield cls(http, https, quic)


def _bind_edges(first: socket.socket, edges: int, stack: ExitStack) -> list[socket.socket]:
    others = (bind_shared(first) for _ in range(edges - 1))
    return [stack.enter_context(first), *map(stack.enter_context, others)]


def _listen(address: Address, flag: str, settings: RenderSettings, stack: ExitStack) -> socket.socket:
    with listen_errors(address, flag):
        return stack.enter_context(address.listen(HttpLimits.from_settings(settings.http_limits).unread_s))
