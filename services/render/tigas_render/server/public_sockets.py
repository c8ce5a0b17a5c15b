"""All public sockets of the service. The supervisor keeps them open, so that an edge can end without a packet's loss.

An edge that is started again gets the same ones: the numbers of the sockets of a port never change.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.runner import explained
from tigas_render.settings import RenderSettings
from tigas_render.transport.shared_port import steer
from tigas_render.transport.udp import SOCKET_BUFFER, bind_all, bind_another


@dataclass(frozen=True, slots=True)
class PublicSockets:
    """Bound, and listening where they are TCP's."""

    http: socket.socket
    https: socket.socket | None
    quic: tuple[tuple[socket.socket, ...], ...]
    """Of each edge: one, or one for each of two families; none if QUIC is off."""
    relays: tuple[tuple[socket.socket, socket.socket], ...]
    """For each edge: its receiving end, and the sockets that lead there, for datagrams delivered to another edge. None
    if the kernel delivers each to the right one.
    """

    @property
    def http_port(self) -> int:
        return int(self.http.getsockname()[1])

    @property
    def https_port(self) -> int | None:
        return None if self.https is None else int(self.https.getsockname()[1])

    @property
    def quic_port(self) -> int | None:
        return int(self.quic[0][0].getsockname()[1]) if self.quic else None

    def fds(self) -> tuple[int, ...]:
        """The file descriptors of all edges, each of which inherits them all."""
        tcp = (self.http,) if self.https is None else (self.http, self.https)
        groups = (tcp, *self.quic, *self.relays)
        return tuple(sock.fileno() for group in groups for sock in group)

    @classmethod
    @contextmanager
    def bound(cls, settings: RenderSettings, edges: int) -> Iterator[PublicSockets]:
        """Open the sockets, as a context manager. Raises StartError for an unusable address."""
        with ExitStack() as stack:
            quic: tuple[tuple[socket.socket, ...], ...] = ()
            relays: tuple[tuple[socket.socket, socket.socket], ...] = ()
            if settings.quic is not None:
                with explained(settings.quic, "--quic"):
                    families = [
                        _group(first, edges, stack) for first in bind_all(settings.quic.host, settings.quic.port)
                    ]
                quic = tuple(zip(*families, strict=True))
                if edges > 1 and not all(steer(family[0], edges) for family in families):
                    relays = tuple(_relay(stack) for _ in range(edges))
            https = None if settings.https is None else _listen(settings.https, "--https", settings, stack)
            http = _listen(settings.http, "--http", settings, stack)
            yield cls(http, https, quic, relays)


def _group(first: socket.socket, edges: int, stack: ExitStack) -> list[socket.socket]:
    others = (bind_another(first) for _ in range(edges - 1))
    return [stack.enter_context(first), *map(stack.enter_context, others)]


def _relay(stack: ExitStack) -> tuple[socket.socket, socket.socket]:
    """A connected pair, with a queue bounded by bytes, unlike a named socket's limit of ten datagrams."""
    inbox, outbox = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    outbox.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER)
    return stack.enter_context(inbox), stack.enter_context(outbox)


def _listen(address: Address, flag: str, settings: RenderSettings, stack: ExitStack) -> socket.socket:
    with explained(address, flag):
        return stack.enter_context(address.listen(HttpLimits.of(settings.http_limits).unread_s))
