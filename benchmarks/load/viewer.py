"""One viewer: a movement at its own pace over HTTP/3, and the outcome of every due frame."""

from __future__ import annotations

import asyncio
import math
import socket
import time
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from typing import Any

from aioquic.quic.connection import QuicConnection

from benchmarks.load.plan import Plan
from tigas import http3
from tigas.http3 import Http3Connection, Http3Failed, configuration

IN_FLIGHT = 8
"""Maximum frames in flight of a viewer; a frame that is due beyond it is not requested."""
CONNECT_S = 10.0
IDLE_S = 10.0
"""A connection without packets is over after this many seconds."""
COMES_AGAIN_S = 1.0
"""Seconds until a refused or disconnected viewer returns, unless the service sets another time."""
SERVED = "served"
FATES = {200: SERVED, 409: "superseded", 429: "refused", 503: "overloaded", 504: "late"}
"""By an answer's status; with any other, it has `failed`."""
LATE = ("superseded", "late")
AFTER_REFUSAL_S = 0.15
"""A viewer refused for another reason pauses for this many seconds, like the page."""
GOLDEN = 0.618034
"""Multiples of it, modulo 1, are spread evenly, however many there are."""
CONNECTION_WINDOW, STREAM_WINDOW = 15 << 20, 6 << 20
"""Bytes that the server may send ahead, as to Chromium."""
BUFFER = 4 << 20
"""Requested receive buffer of the socket, in bytes."""


@dataclass(frozen=True, slots=True)
class Due:
    """Outcome of a due frame. Times are seconds of the monotonic clock."""

    at: float
    fate: str
    """`served`; `overtaken` by a newer frame, and cancelled by the viewer; `superseded`, `late`, `overloaded`,
    `refused` or `failed`, as reported by the service; `lost` with the connection; or not requested: too many are
    `waiting`, the viewer was `paced` by the service's rate or just refused, or it was `outside`, without a session.
    """
    took: float = math.nan
    """From sending the request to the last byte, if there was an answer."""
    there: float = math.nan
    """When that was."""
    size: int = 0
    """Bytes of the frame."""
    lag: float = 0.0
    """How late this process sent the request."""


@dataclass(frozen=True, slots=True)
class _Asked:
    seq: int
    due: float
    sent: float


class ViewerConnection(Http3Connection):
    """Transmits once for all datagrams that were read together, and so acknowledges them together."""

    _soon: asyncio.Handle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)

    def transmit(self) -> None:
        if self._soon is None:
            self._soon = asyncio.get_running_loop().call_soon(self._transmit)

    def close(self, *arguments: Any, **named: Any) -> None:
        super().close(*arguments, **named)
        self._transmit()

    def _transmit(self) -> None:
        if self._soon is not None:
            self._soon.cancel()
            self._soon = None
        if self._transport is not None and not self._transport.is_closing():
            super().transmit()


class Viewer:
    """A viewer of the scene from its arrival until it leaves."""

    def __init__(self, plan: Plan, number: int) -> None:
        """number: of all viewers, from 0; gives an address, a movement and a place in it."""
        self.ended: list[Due] = []
        """Outcomes since the list was last cleared."""
        self._plan = plan
        self._posts = plan.transport == "post" or (plan.transport == "mixed" and number % 2 == 1)
        self._source = _address(number) if plan.host.startswith("127.") else None
        self._route = number % len(plan.routes)
        self._frame = int(number * GOLDEN % 1 * len(plan.routes[self._route]))
        self._interval = 1 / plan.frames_per_s
        self._phase = number * GOLDEN % 1 * self._interval
        self._asked: dict[asyncio.Task[None], _Asked] = {}
        """The oldest first."""
        self._seq = 0
        self._spacing = 0.0
        """Of requests, that the service asks for, in seconds."""
        self._not_before = 0.0
        self._connection: ViewerConnection | None = None
        """While it may ask for frames."""
        self._session = -1
        """Of WebTransport."""
        self._running: list[asyncio.Task[None]] = []

    def come(self) -> None:
        """Connect, and begin to move."""
        self._running = [asyncio.create_task(self._visit_again_and_again()), asyncio.create_task(self._move())]

    def leave(self) -> None:
        """Close the connection."""
        for task in (*self._running, *self._asked):
            task.cancel()
        self._asked.clear()

    @property
    def is_inside(self) -> bool:
        """Whether it may ask for frames."""
        return self._connection is not None

    def waiting(self) -> list[float]:
        """Due times of the frames in flight."""
        return [asked.due for asked in self._asked.values()]

    # -- connecting --------------------------------------------------------------------------------------------------

    async def _visit_again_and_again(self) -> None:
        while True:
            retry_after_s = COMES_AGAIN_S
            with suppress(OSError, TimeoutError):
                retry_after_s = await self._visit()
            self.ended += [Due(asked.due, "lost") for asked in self._asked.values()]
            for task in self._asked:
                task.cancel()
            self._asked.clear()
            self._spacing = 0.0
            await asyncio.sleep(retry_after_s)

    async def _visit(self) -> float:
        """One connection to its end; returns after how many seconds to come again."""
        quic = QuicConnection(
            configuration=configuration(max_data=CONNECTION_WINDOW, max_stream_data=STREAM_WINDOW, idle_timeout=IDLE_S)
        )
        address = self._plan.host, self._plan.port
        async with AsyncExitStack() as stack:
            async with asyncio.timeout(CONNECT_S):
                connecting = http3.connect(ViewerConnection, address, quic, source=self._source)
                connection = await stack.enter_async_context(connecting)
                if not self._posts:
                    self._session = await connection.connect_webtransport(authority=f"{address[0]}:{address[1]}")
                    answer = connection.responses[self._session]
                    if answer.status != 200:
                        return float(answer.headers.get(b"retry-after", COMES_AGAIN_S)) or COMES_AGAIN_S
            self._connection = connection
            try:
                await connection.until(lambda: connection.is_closed or connection.responses[self._session].done)
            finally:
                self._connection = None
        return COMES_AGAIN_S

    # -- asking ------------------------------------------------------------------------------------------------------

    async def _move(self) -> None:
        """Request a frame at each tick, unless the viewer has to wait."""
        due = time.monotonic() + self._phase
        while True:
            await asyncio.sleep(due - time.monotonic())
            now = time.monotonic()
            self._frame += 1
            if self._connection is None:
                self.ended.append(Due(due, "outside"))
            elif now < self._not_before:
                self.ended.append(Due(due, "paced"))
            elif len(self._asked) >= IN_FLIGHT:
                self.ended.append(Due(due, "waiting"))
            else:
                self._seq += 1
                self._not_before = max(self._not_before, now - self._interval) + self._spacing
                asked = _Asked(self._seq, due, now)
                body = self._plan.request(self._route, self._frame, self._seq)
                self._asked[asyncio.create_task(self._ask(self._connection, asked, body))] = asked
            due += self._interval

    async def _ask(self, connection: ViewerConnection, asked: _Asked, body: bytes) -> None:
        try:
            status, rate, size = await self._answer(connection, body)
        except Http3Failed:  # with the connection, which counts it as lost, or reset
            if not connection.is_closed:
                self._ended(Due(asked.due, "failed"))
            return
        now = time.monotonic()
        fate = FATES.get(status, "failed")
        self._ended(Due(asked.due, fate, now - asked.sent, now, size, asked.sent - asked.due))
        self._spacing = 1 / rate if rate else 0.0
        if fate == SERVED:
            self._overtake(asked.seq)
        elif fate not in LATE:
            self._not_before = now + AFTER_REFUSAL_S

    async def _answer(self, connection: ViewerConnection, body: bytes) -> tuple[int, float | None, int]:
        """Status, the rate that the service asks for, and size of a frame."""
        if not self._posts:
            header, frame = await connection.frame(self._session, body)
            return int(header["status"]), header.get("requests_per_s"), len(frame)
        answer = await connection.post(f"{self._plan.host}:{self._plan.port}", "/render", body)
        about = dict(part.split("=") for part in answer.headers.get("tigas-frame", "").split(", ") if part)
        return answer.status_code, float(about.get("requests_per_s", 0)) or None, len(answer.content)

    def _ended(self, due: Due) -> None:
        task = asyncio.current_task()
        if task is not None and self._asked.pop(task, None) is not None:
            self.ended.append(due)

    def _overtake(self, seq: int) -> None:
        """Cancel the frames before the received one."""
        for task, asked in list(self._asked.items()):
            if asked.seq < seq:
                del self._asked[task]
                self.ended.append(Due(asked.due, "overtaken"))
                task.cancel()


def _address(number: int) -> str:
    """Of a viewer on this machine: the service is fair between addresses, and so each has its own."""
    return f"127.1.{number // 250}.{number % 250 + 1}"
