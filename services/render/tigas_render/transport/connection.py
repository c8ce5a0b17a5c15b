"""One client's QUIC connection: datagrams and time in, datagrams out; contents are handled by `routing`."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import Protocol

from aioquic.h3.connection import ErrorCode
from aioquic.quic.events import (
    ConnectionIdIssued,
    ConnectionIdRetired,
    ConnectionTerminated,
    HandshakeCompleted,
    ProtocolNegotiated,
)

from tigas_render.admission.connections import Usage
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.gso import Address, Datagram
from tigas_render.transport.routing import Router, Service

logger = logging.getLogger(__name__)

_now = time.monotonic
"""The event loop's own clock, read afresh: uvloop's `time()` is constant within an iteration and ticks in milliseconds,
too coarse for round trips and pacing.
"""


class ConnectionOwner(Protocol):
    """A connection's interface to the server."""

    def send(self, datagrams: list[Datagram]) -> None:
        """Put datagrams on the network."""

    def issued(self, connection: Connection, cid: bytes) -> None:
        """The client may use this connection id from now on."""

    def retired(self, connection: Connection, cid: bytes) -> None:
        """The client does not use this connection id any more."""

    def established(self, connection: Connection) -> None:
        """The handshake is complete."""

    def terminated(self, connection: Connection) -> None:
        """The connection is over."""


class Connection:
    """Drives one aioquic connection."""

    def __init__(
        self,
        quic: ServerQuicConnection,
        owner: ConnectionOwner,
        service: Service,
        client: tuple[str, int],
        server: tuple[str, int],
        usage: Usage,
    ) -> None:
        """usage: resource usage of the client's address."""
        self.usage = usage
        self.router: Router | None = None
        """The client's open streams and sessions, once the handshake has begun."""
        self._quic = quic
        self._owner = owner
        self._service = service
        self._client = client
        self._server = server
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at = 0.0
        """Time of the armed timer: before `_due` if that was postponed, since a timer costs more than reading the
        clock.
        """
        self._due: float | None = None
        """When there is something to do."""
        self._transmit_handle: asyncio.Handle | None = None
        self._abandoned = False
        self._handshake_timer = self._loop.call_later(service.limits.handshake_timeout, self._handshake_late)

    # -- state -------------------------------------------------------------------------------------------------------

    @property
    def is_established(self) -> bool:
        """Whether the handshake is complete; earlier requests may be replays."""
        return self._quic.is_established

    # -- network -----------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, address: Address, arrived: float) -> None:
        """Take one datagram that arrived some time ago; `transmit` must follow once all that wait are in."""
        try:
            self._quic.receive_datagram(data, address, now=_now())
            self._process_events(arrived)
        except Exception:
            self._fail()

    def transmit(self) -> None:
        """Send everything allowed now, and arm the timer for the rest."""
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
            self._transmit_handle = None
        try:
            if not self._abandoned:
                self._transmit()
        except Exception:
            self._fail()

    def transmit_soon(self) -> None:
        """Send once the running callbacks are done, so that many writes share packets."""
        if self._transmit_handle is None and not self._abandoned:
            self._transmit_handle = self._loop.call_soon(self.transmit)

    def _transmit(self) -> None:
        more = True
        while more:
            more = self.router is not None and self.router.writer.hand_over_datagrams()
            datagrams = self._quic.datagrams_to_send(now=_now())
            if not datagrams:
                break
            self._owner.send(datagrams)
        if self.router is not None:
            self.router.writer.wake()
            self.router.set_away(self._quic.is_away(_now()))
        due = self._quic.get_timer()
        late = self.router.deadline if self.router is not None else None
        self._due = due if due is None or late is None else min(due, late)  # none once the connection has ended
        self._arm()

    def _arm(self) -> None:
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
            self._arm()
            return
        try:
            self._quic.handle_timer(now=now)
            self._process_events(now)
            if self.router is not None:
                self.router.end_late(now)
        except Exception:
            self._fail()
        self.transmit()

    def _fail(self) -> None:
        """An error provoked by a client ends only its own connection."""
        logger.exception("The connection from %s failed", self._client[0])
        self.abandon()
        self._owner.terminated(self)

    def _handshake_late(self) -> None:
        if not self.is_established:
            self.close(ErrorCode.H3_NO_ERROR, "The handshake took too long")

    # -- closing -----------------------------------------------------------------------------------------------------

    def close(self, error_code: int = ErrorCode.H3_NO_ERROR, reason: str = "") -> None:
        """Close the connection; running requests end as if the client had cancelled them."""
        self._quic.close(error_code=error_code, reason_phrase=reason)
        self._end_everything()
        self.transmit()

    def abandon(self) -> None:
        """Forget the connection without a word to the client: no more timers, no more tasks."""
        self._abandoned = True
        self._handshake_timer.cancel()
        if self._timer is not None:
            self._timer.cancel()
        if self._transmit_handle is not None:
            self._transmit_handle.cancel()
        self._end_everything()

    def _end_everything(self) -> None:
        self._handshake_timer.cancel()
        if self.router is not None:
            self.router.close()

    # -- events ------------------------------------------------------------------------------------------------------

    def _process_events(self, arrived: float) -> None:
        while (event := self._quic.next_event()) is not None:
            match event:
                case ConnectionIdIssued():
                    self._owner.issued(self, event.connection_id)
                case ConnectionIdRetired():
                    self._owner.retired(self, event.connection_id)
                case ConnectionTerminated():
                    self._end_everything()
                    self._owner.terminated(self)
                case HandshakeCompleted():
                    self._handshake_timer.cancel()
                    self._owner.established(self)
                case ProtocolNegotiated():
                    self.router = Router(
                        self._quic, self._service, self._client, self._server, self.usage, self.transmit_soon
                    )
                case _ if self.router is not None:
                    self.router.received(event, arrived)
        if self.router is not None:
            self.router.watch(self._quic.take_begun(), arrived)
