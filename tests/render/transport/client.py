"""The package's HTTP/3 client with hooks for tests, and small applications for the transport's tests."""

from __future__ import annotations

import asyncio
import json
import ssl
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from datetime import UTC, datetime
from typing import Any

from aioquic.h3.events import DatagramReceived, H3Event
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import ConnectionTerminated, HandshakeCompleted, QuicEvent
from aioquic.tls import SessionTicket

from tests.render.fakes import render_request
from tigas import http3
from tigas.http3 import Http3Connection, Response, configuration
from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo
from tigas_render.frame import Answered, Frame, FrameSource, Withdraw
from tigas_render.frame import Client as FrameClient
from tigas_render.transport.certificate import Certificate

CERTIFICATE = Certificate.create([], datetime.now(UTC))
TIMING = ServerTiming(queue=1.0, render=2.0, encode=3.0)


class Client(Http3Connection):
    """A connection that also keeps datagrams and how it began and ended. It waits for 20 s at most."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.datagrams: list[bytes] = []
        self.terminated: ConnectionTerminated | None = None
        self.handshake: HandshakeCompleted | None = None

    def quic_event_received(self, event: QuicEvent) -> None:
        match event:
            case ConnectionTerminated():
                self.terminated = event
            case HandshakeCompleted():
                self.handshake = event
        super().quic_event_received(event)

    def http_event_received(self, event: H3Event) -> None:
        if isinstance(event, DatagramReceived):
            self.datagrams.append(event.data)
        super().http_event_received(event)

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(20):
            await super().until(condition)

    async def handshaken(self) -> HandshakeCompleted:
        await self.until(lambda: self.handshake)
        assert self.handshake is not None
        return self.handshake

    @property
    def address(self) -> tuple[str, int]:
        """Its own host and port."""
        assert self._transport is not None
        host, port = self._transport.get_extra_info("sockname")[:2]
        return host, port

    def vanish(self) -> None:
        """Leave without closing the connection."""
        self._quic.close = lambda **_: None  # type: ignore[method-assign]

    async def fetch(self, method: str, path: str, body: bytes | None = None, **kwargs: Any) -> Response:
        """The response to a whole request."""
        return await self.response(self.request(method, path, body, **kwargs))

    def send_datagram(self, session: int, data: bytes) -> None:
        self.h3.send_datagram(session, data)
        self.transmit()


def connect(
    port: int,
    *,
    host: str = "127.0.0.1",
    source: str | None = None,
    ticket: SessionTicket | None = None,
    on_ticket: Callable[[SessionTicket], None] | None = None,
    wait: bool = True,
    certificate: Certificate | None = CERTIFICATE,
    max_datagram: int = 65536,
    **changes: Any,
) -> AbstractAsyncContextManager[Client]:
    """A connected client, from the address `source` if it is not the server's; `changes` go to aioquic's configuration.

    Without a `certificate` it accepts every server's.
    """
    verified = {"verify_mode": ssl.CERT_REQUIRED, "cadata": certificate.pem} if certificate else {}
    config = configuration(max_datagram_frame_size=max_datagram, session_ticket=ticket, **verified, **changes)
    quic = QuicConnection(configuration=config, session_ticket_handler=on_ticket)
    return http3.connect(Client, (host, port), quic, source=source or host, wait=wait)


def request_body(**changes: Any) -> bytes:
    """A RenderRequest's JSON, with changes."""
    request = render_request(profile=None).model_dump(mode="json", exclude_unset=True, exclude_none=True)
    return json.dumps(request | changes).encode()


class Recorder:
    """Events on the server's side, for a test to wait for."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self._news = asyncio.Event()

    def add(self, event: str) -> None:
        self.events.append(event)
        self._news.set()

    async def until(self, event: str) -> None:
        async with asyncio.timeout(20):
            while event not in self.events:
                self._news.clear()
                await self._news.wait()


class FakeFrames(FrameSource):
    """A FrameSource: answers at once with `body`, or, if `held`, when the test lets a request go."""

    def __init__(self, body: bytes = b"frame") -> None:
        self.body = body
        self.held: bool | set[int] = False
        """Whether requests wait for `release`: all, none, or those with these numbers."""
        self.error: Exception | None = None
        self.video = VideoInfo(key=True, after=None, codec="avc1.4d401f")
        """Of frames that are asked for as a video's."""
        self.requests: list[tuple[FrameClient, RenderRequest]] = []
        self.arrivals: list[float] = []
        self.cancelled: list[int] = []
        self.forgotten: list[FrameClient] = []
        self._gates: dict[int, asyncio.Future[None]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._news = asyncio.Event()

    def request(self, client: FrameClient, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        self.requests.append((client, request))
        self.arrivals.append(arrived)
        self._news.set()
        task = asyncio.create_task(self._answer(request, answered))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return lambda: None if task.done() else self._cancel(task, request.seq)

    def forget(self, client: FrameClient) -> None:
        self.forgotten.append(client)
        self._news.set()

    async def _answer(self, request: RenderRequest, answered: Answered) -> None:
        if self.held is True or (self.held and request.seq in self.held):
            await self._gate(request.seq)
        x, y = round(320 * request.overscan), round(180 * request.overscan)
        size = (320 + 2 * x, 180 + 2 * y)
        format: AnswerFormat = "h264" if request.format == "h264" else "jpeg"
        video = self.video if request.format == "h264" else None
        answered(self.error or Frame(self.body, format, *size, request.seq, request.profile, TIMING, x, y, video))

    def _cancel(self, task: asyncio.Task[None], seq: int) -> None:
        task.cancel()
        self.cancelled.append(seq)
        self._news.set()

    def release(self, seq: int) -> None:
        self._gate(seq).set_result(None)

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(20):
            while not condition():
                self._news.clear()
                await self._news.wait()

    def _gate(self, seq: int) -> asyncio.Future[None]:
        return self._gates.setdefault(seq, asyncio.get_running_loop().create_future())
