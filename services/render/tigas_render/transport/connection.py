"""One client's QUIC connection: datagrams and time in, datagrams out. `routing` handles the contents."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Iterator

from aioquic.h3.connection import ErrorCode
from aioquic.quic.events import (
    ConnectionIdIssued,
    ConnectionIdRetired,
    ConnectionTerminated,
    HandshakeCompleted,
    ProtocolNegotiated,
)

from tigas_common.udp import Address, Datagram
from tigas_render.admission.connections import Usage
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.routing import Router

logger = logging.getLogger(__name__)

_now = time.monotonic
"""The event loop's clock, read directly: uvloop's `time()` is constant within an iteration and has a resolution of a
millisecond, which is too coarse for round trips and pacing.
"""


class Connections:
    """All connections of a server, by connection id and by address."""

    def __init__(self, send: Callable[[list[Datagram]], None], on_count_change: Callable[[int], None]) -> None:
        """send: sends datagrams to one address. on_count_change: called with the new number of connections."""
        self.send = send
        self._on_count_change = on_count_change
        self._cids: dict[Connection, set[bytes]] = {}
        """The connection ids that each connection's client may use."""
        self.by_cid: dict[bytes, Connection] = {}
        self.handshaking: set[Connection] = set()
        self.dirty: set[Connection] = set()
        """Connections that have received something and must transmit."""
        self.usage: dict[str, Usage] = {}
        """Resource usage by address, for addresses with connections."""

    def __len__(self) -> int:
        return len(self._cids)

    def __iter__(self) -> Iterator[Connection]:
        return iter(self._cids)

    def add(self, connection: Connection, *cids: bytes) -> None:
        """Add a connection, with the connection ids that its client may use at first."""
        self._cids[connection] = set()
        for cid in cids:
            self.add_cid(connection, cid)
        self.handshaking.add(connection)
        self.usage[connection.usage.address] = connection.usage
        connection.usage.connections += 1
        self._on_count_change(len(self._cids))

    def add_cid(self, connection: Connection, cid: bytes) -> None:
        """Record that the client may use a connection id from now on."""
        self.by_cid[cid] = connection
        self._cids[connection].add(cid)

    def remove_cid(self, connection: Connection, cid: bytes) -> None:
        """Record that the client no longer uses a connection id."""
        self.by_cid.pop(cid, None)
        self._cids[connection].discard(cid)

    def remove(self, connection: Connection) -> None:
        """Remove a connection that has ended. Further calls have no effect."""
        self.dirty.discard(connection)
        self.handshaking.discard(connection)
        if connection not in self._cids:
            return
        for cid in self._cids.pop(connection):
            self.by_cid.pop(cid, None)
        self._on_count_change(len(self._cids))
        connection.usage.connections -= 1
        if not connection.usage.connections:
            del self.usage[connection.usage.address]


class Connection:
    """Drives one aioquic connection."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        connections: Connections,
        usage: Usage,
        make_router: Callable[[Callable[[], None]], Router],
        handshake_timeout: float,
    ) -> None:
        """usage: resource usage of the client's address. make_router: called with `transmit_soon`."""
        self.usage = usage
        self.router: Router | None = None
        """The client's open streams and sessions, once the handshake has begun."""
        self._quic = quic
        self._connections = connections
        self._make_router = make_router
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at = 0.0
        """When the timer fires: before `_due` if that has been postponed, because setting a timer costs more than
        reading the clock.
        """
        self._due: float | None = None
        """When there will be something to do."""
        self._transmit_handle: asyncio.Handle | None = None
        self._abandoned = False
        self._handshake_timer = self._loop.call_later(
            handshake_timeout, self.close, ErrorCode.H3_NO_ERROR, "The handshake took too long"
        )

    def receive(self, data: bytes, address: Address, arrived: float) -> None:
        """Handle a datagram that arrived at `arrived`. Call `transmit` after all waiting datagrams are handled."""
        try:
            self._quic.receive_datagram(data, address, now=_now())
            self._process_events(arrived)
        except Exception:
            self._fail()

    def transmit(self) -> None:
        """Send all that may be sent now, and set the timer for the rest."""
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
            self._transmit_handle = None
        try:
            if not self._abandoned:
                self._transmit()
        except Exception:
            self._fail()

    def transmit_soon(self) -> None:
        """Send after the current callbacks of the event loop, so that many writes share packets."""
        if self._transmit_handle is None and not self._abandoned:
            self._transmit_handle = self._loop.call_soon(self.transmit)

    def _transmit(self) -> None:
        more = True
        while more:
            more = self.router is not None and self.router.scheduler.flush()
            datagrams = self._quic.datagrams_to_send(now=_now())
            if not datagrams:
                break
            self._connections.send(datagrams)
        if self.router is not None:
            self.router.scheduler.resume_streams()
            self.router.set_unresponsive(self._quic.is_unresponsive(_now()))
        due = self._quic.get_timer()
        late = self.router.next_deadline if self.router is not None else None
        self._due = due if due is None or late is None else min(due, late)  # None once the connection has ended
        self._set_timer()

    def _set_timer(self) -> None:
        if self._due is None or (self._timer is not None and self._timer_at <= self._due):
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_at = self._due
        self._timer = self._loop.call_at(self._due, self._handle_timer)

    def _handle_timer(self) -> None:
        now = max(self._timer_at, _now())
        self._timer = None
        if self._due is None or self._due > now:
            self._set_timer()
            return
        try:
            self._quic.handle_timer(now=now)
            self._process_events(now)
            if self.router is not None:
                self.router.abort_late_streams(now)
        except Exception:
            self._fail()
        self.transmit()

    def _fail(self) -> None:
        """End this connection only, after an error that its client may have provoked."""
        logger.exception("The connection from %s failed", self.usage.address)
        self.abandon()
        self._connections.remove(self)

    def close(self, error_code: int = ErrorCode.H3_NO_ERROR, reason: str = "") -> None:
        """Close the connection; running requests end as if the client had cancelled them."""
        self._quic.close(error_code=error_code, reason_phrase=reason)
        self._clean_up()
        self.transmit()

    def abandon(self) -> None:
        """End the connection without notifying the client, including all timers and tasks."""
        self._abandoned = True
        self._handshake_timer.cancel()
        if self._timer is not None:
            self._timer.cancel()
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
        self._clean_up()

    def _clean_up(self) -> None:
        self._handshake_timer.cancel()
        if self.router is not None:
            self.router.close()

    def _process_events(self, arrived: float) -> None:
        while (event := self._quic.next_event()) is not None:
            match event:
                case ConnectionIdIssued():
                    self._connections.add_cid(self, event.connection_id)
                case ConnectionIdRetired():
                    self._connections.remove_cid(self, event.connection_id)
                case ConnectionTerminated():
                    self._clean_up()
                    self._connections.remove(self)
                case HandshakeCompleted():
                    self._handshake_timer.cancel()
                    self._connections.handshaking.discard(self)
                case ProtocolNegotiated():
                    self.router = self._make_router(self.transmit_soon)
                case _ if self.router is not None:
                    self.router.handle_event(event, arrived)
        if self.router is not None:
            self.router.watch_streams(self._quic.pop_gapped_streams(), arrived)
