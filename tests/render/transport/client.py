"""The package's HTTP/3 client with hooks for tests, and a source of frames under the test's control."""

from __future__ import annotations

import asyncio
import json
import ssl
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from datetime import UTC, datetime
from functools import partial
from typing import Any

from aioquic.h3.events import DatagramReceived, H3Event
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import ConnectionTerminated, HandshakeCompleted, QuicEvent
from aioquic.tls import SessionTicket

from tests.eventually import eventually
from tests.render.fakes import render_request
from tigas import http3
from tigas.http3 import Http3Connection, Response, configuration, split_frame
from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo
from tigas_render.frame import Cancel, Frame, FrameSource, OnAnswer
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

    @property
    def address(self) -> tuple[str, int]:
        """Its own host and port."""
        assert self._transport is not None
        host, port = self._transport.get_extra_info("sockname")[:2]
        return host, port

    async def fetch(self, method: str, path: str, body: bytes | None = None, **kwargs: Any) -> Response:
        """The response to a whole request."""
        return await self.response(self.request(method, path, body, **kwargs))

    def send(self, stream: int, data: bytes, end: bool = False) -> None:
        """Send on a stream, below HTTP/3."""
        self._quic.send_stream_data(stream, data, end)
        self.transmit()

    async def header(self, stream: int) -> dict[str, Any]:
        """The FrameHeader of the answer on a stream."""
        return split_frame(bytes((await self.response(stream)).body))[0]

    async def end(self, session: int) -> None:
        """End a session."""
        self.send(session, b"", end=True)
        await self.response(session)

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


class FakeFrames(FrameSource):
    """Answers at once with `body` or `error`, or, if `held`, when the test lets a request go."""

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
        self._waiting: dict[int, tuple[RenderRequest, OnAnswer]] = {}

    def request(self, client: FrameClient, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        number = len(self.requests)
        self.requests.append((client, request))
        self.arrivals.append(arrived)
        self._waiting[number] = request, on_answer
        if self.held is False or (self.held is not True and request.seq not in self.held):
            asyncio.get_running_loop().call_soon(self._answer, number)
        return partial(self._cancel, number)

    def forget(self, client: FrameClient) -> None:
        self.forgotten.append(client)

    def release(self, seq: int) -> None:
        """Answer the requests with this number that wait."""
        for number in [number for number, (request, _) in self._waiting.items() if request.seq == seq]:
            self._answer(number)

    def _answer(self, number: int) -> None:
        request, on_answer = self._waiting.pop(number, (None, None))
        if request is None or on_answer is None:  # it was cancelled
            return
        x, y = round(320 * request.overscan), round(180 * request.overscan)
        size = (320 + 2 * x, 180 + 2 * y)
        format: AnswerFormat = "h264" if request.format == "h264" else "jpeg"
        video = self.video if request.format == "h264" else None
        frame = Frame(self.body, format, *size, request.seq, request.profile, TIMING, x, y, video, request.coarse)
        on_answer(self.error or frame)

    def _cancel(self, number: int) -> None:
        if number in self._waiting:
            self.cancelled.append(self._waiting.pop(number)[0].seq)

    async def until(self, condition: Callable[[], object]) -> None:
        await eventually(condition)
