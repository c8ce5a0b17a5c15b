"""uvicorn's HTTP/1.1 connection, with limits on how long a request takes to arrive."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from http import HTTPStatus

import h11
from uvicorn import Config
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from tigas_common.errors import InvalidRequest, RequestTimeout, TigasError, problem
from tigas_common.http_limits import HttpLimits
from tigas_common.patience import Patience
from tigas_common.peers import ARRIVED


class LimitedProtocol(H11Protocol):
    """One connection. uvicorn bounds how long it is idle, and this how long each request takes to arrive."""

    def __init__(
        self, config: Config, server_state: ServerState, limits: HttpLimits, opened: Callable[[], None]
    ) -> None:
        """Calls `opened` once uvicorn knows of the connection."""
        super().__init__(config, server_state, app_state={})
        self.timeout_keep_alive = limits.idle_s
        self._limits = limits
        self._opened = opened
        self._began = False
        """Whether anything has ever come."""
        self._awaited: object = None
        """The state of the client that `_patience` is for."""
        self._patience: Patience | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.flow = _Flow(transport, self._resumed)
        self._opened()
        self._watch()

    def data_received(self, data: bytes) -> None:
        self._began = True
        self.app_state[ARRIVED] = time.monotonic()  # every request's scope gets a copy when its head is complete
        super().data_received(data)
        self._watch(len(data))

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    def _watch(self, received: int = 0) -> None:
        """Start, continue or stop the timeout, depending on the data expected from the client."""
        now, state = self.loop.time(), self.conn.their_state
        if self.transport.get_protocol() is not self:  # it is a WebSocket now
            state = h11.SWITCHED_PROTOCOL
        if state is self._awaited and self._patience is not None:
            self._patience.progress(received, now)
            return
        self._awaited = state
        if state is h11.SEND_BODY:
            self._begin(self._limits.body_s, self._limits.body_bytes_per_s)
        elif state is h11.IDLE and self.timeout_keep_alive_task is None:
            self._begin(self._limits.header_s, math.inf)  # received data does not extend it
        else:
            self._patience = None

    def _begin(self, seconds: float, bytes_per_s: float) -> None:
        self._patience = Patience(seconds, bytes_per_s, self.loop.time())
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(self._patience.until, self._expired)

    def _resumed(self) -> None:
        """The application reads on: until now it was late, and not the client."""
        if self._patience is not None:
            self._begin(self._patience.seconds, self._patience.bytes_per_s)

    def _expired(self) -> None:
        if self._patience is None or self.flow.read_paused or self.transport.is_closing():
            return
        if self.loop.time() < self._patience.until:
            self._timer = self.loop.call_at(self._patience.until, self._expired)
        else:
            what = "body" if self._awaited is h11.SEND_BODY else "headers"
            self._give_up(RequestTimeout(f"The request's {what} did not come in time."))

    def send_400_response(self, msg: str) -> None:
        """uvicorn would answer even if the application has, and let the application answer even after that."""
        self._give_up(InvalidRequest("The request is not valid HTTP/1.1."))

    def _give_up(self, error: TigasError) -> None:
        if self.cycle is not None and not self.cycle.response_complete:  # further data is dropped
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if self._began and self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.write(last_answer(error))
        self.transport.close()


class _Flow(FlowControl):
    """uvicorn's flow control, which reports when it resumes reading."""

    def __init__(self, transport: asyncio.Transport, resumed: Callable[[], None]) -> None:
        super().__init__(transport)
        self._resumed = resumed

    def resume_reading(self) -> None:
        if self.read_paused:
            super().resume_reading()
            self._resumed()


def last_answer(error: TigasError) -> bytes:
    """A failure as the bytes of an HTTP/1.1 response after which the connection is closed."""
    answer = problem(error)
    body = answer.model_dump_json().encode()
    lines = (
        f"HTTP/1.1 {answer.status} {HTTPStatus(answer.status).phrase}",
        "Content-Type: application/problem+json",
        f"Content-Length: {len(body)}",
        "Cache-Control: no-store",
        "Connection: close",
    )
    return "\r\n".join((*lines, "", "")).encode() + body
