"""An HTTP/3 and WebTransport client on aioquic, and the small things that the transport's tests serve."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import ssl
import struct
from collections import defaultdict
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DatagramReceived, DataReceived, HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import (
    ConnectionTerminated,
    HandshakeCompleted,
    QuicEvent,
    StopSendingReceived,
    StreamDataReceived,
    StreamReset,
)
from aioquic.tls import SessionTicket

from tests.render.fakes import render_request
from tigas_common.certificate import Certificate
from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo
from tigas_render.frame import Answered, Frame, FrameSource, Withdraw
from tigas_render.frame import Client as FrameClient

CERTIFICATE = Certificate.create([], datetime.now(UTC))
TIMING = ServerTiming(queue=1.0, render=2.0, encode=3.0)


@dataclass
class Response:
    """What has arrived on one stream."""

    status: int = 0
    headers: dict[bytes, bytes] = field(default_factory=dict)
    body: bytearray = field(default_factory=bytearray)
    ended: bool = False
    reset: int | None = None
    stopped: int | None = None

    @property
    def done(self) -> bool:
        return self.ended or self.reset is not None


class Client(QuicConnectionProtocol):
    """One connection. Waits with `until`, which looks again whenever something has arrived."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.h3 = H3Connection(self._quic, enable_webtransport=True)
        self.responses: dict[int, Response] = defaultdict(Response)
        self.datagrams: list[bytes] = []
        self.terminated: ConnectionTerminated | None = None
        self.handshake: HandshakeCompleted | None = None
        self.goaway = False
        self._raw: set[int] = set()
        self._news = asyncio.Event()

    def quic_event_received(self, event: QuicEvent) -> None:
        match event:
            case ConnectionTerminated():
                self.terminated = event
            case HandshakeCompleted():
                self.handshake = event
            case StreamReset():
                self.responses[event.stream_id].reset = event.error_code
            case StopSendingReceived():
                self.responses[event.stream_id].stopped = event.error_code
        if isinstance(event, StreamDataReceived) and event.stream_id in self._raw:
            # aioquic takes the answer on a WebTransport stream of the client's own for HTTP/3 frames
            self.responses[event.stream_id].body += event.data
            self.responses[event.stream_id].ended |= event.end_stream
            self._news.set()
            return
        for h3_event in self.h3.handle_event(event):
            match h3_event:
                case HeadersReceived():
                    response = self.responses[h3_event.stream_id]
                    response.headers = dict(h3_event.headers)
                    response.status = int(response.headers[b":status"])
                    response.ended |= h3_event.stream_ended
                case DataReceived() | WebTransportStreamDataReceived():
                    response = self.responses[h3_event.stream_id]
                    response.body += h3_event.data
                    response.ended |= h3_event.stream_ended
                case DatagramReceived():
                    self.datagrams.append(h3_event.data)
        self._news.set()

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(20):
            while not condition():
                self._news.clear()
                await self._news.wait()

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
        """Go without a word."""
        self._quic.close = lambda **_: None  # type: ignore[method-assign]

    # -- HTTP --------------------------------------------------------------------------------------------------------

    def request(
        self, method: str, path: str, body: bytes | None = None, headers: list[tuple[bytes, bytes]] | None = None
    ) -> int:
        """Send a whole request; its stream's id."""
        stream_id = self.open_request(method, path, headers, end=body is None)
        if body is not None:
            self.h3.send_data(stream_id, body, end_stream=True)
            self.transmit()
        return stream_id

    def open_request(
        self, method: str, path: str, headers: list[tuple[bytes, bytes]] | None = None, end: bool = False
    ) -> int:
        stream_id = self._quic.get_next_available_stream_id()
        pseudo = [
            (b":method", method.encode()),
            (b":scheme", b"https"),
            (b":authority", b"localhost"),
            (b":path", path.encode()),
        ]
        self.h3.send_headers(stream_id, [*pseudo, *(headers or [])], end_stream=end)
        self.transmit()
        return stream_id

    async def fetch(self, method: str, path: str, body: bytes | None = None, **kwargs: Any) -> Response:
        return await self.response(self.request(method, path, body, **kwargs))

    async def response(self, stream_id: int) -> Response:
        await self.until(lambda: self.responses[stream_id].done)
        return self.responses[stream_id]

    # -- WebTransport ------------------------------------------------------------------------------------------------

    async def connect_webtransport(
        self, path: str = "/render", authority: str = "localhost", origin: str | None = None
    ) -> int:
        stream_id = self._quic.get_next_available_stream_id()
        headers = [
            (b":method", b"CONNECT"),
            (b":protocol", b"webtransport"),
            (b":scheme", b"https"),
            (b":authority", authority.encode()),
            (b":path", path.encode()),
            *([] if origin is None else [(b"origin", origin.encode())]),
        ]
        self.h3.send_headers(stream_id, headers)
        self.transmit()
        await self.until(lambda: self.responses[stream_id].status)
        return stream_id

    def open_stream(self, session: int, data: bytes = b"", end: bool = True) -> int:
        stream_id = self.h3.create_webtransport_stream(session)
        self._raw.add(stream_id)
        self._quic.send_stream_data(stream_id, data, end)
        self.transmit()
        return stream_id

    def stop(self, stream_id: int) -> None:
        """Send STOP_SENDING, as a page does that cancels its reader."""
        self._quic.stop_stream(stream_id, 0x52E4A40FA8DB)
        self.transmit()

    def send_datagram(self, session: int, data: bytes) -> None:
        self.h3.send_datagram(session, data)
        self.transmit()

    async def frame(self, session: int, request: bytes) -> tuple[dict[str, Any], bytes]:
        stream_id = self.open_stream(session, request)
        return split_frame(bytes((await self.response(stream_id)).body))


def split_frame(answer: bytes) -> tuple[dict[str, Any], bytes]:
    """A FrameHeader and the body after it."""
    (length,) = struct.unpack_from("!I", answer)
    return json.loads(answer[4 : 4 + length]), answer[4 + length :]


@contextlib.asynccontextmanager
async def connect(
    port: int,
    *,
    host: str = "127.0.0.1",
    source: str | None = None,
    ticket: SessionTicket | None = None,
    on_ticket: Callable[[SessionTicket], None] | None = None,
    wait: bool = True,
    certificate: Certificate | None = CERTIFICATE,
    **configuration: Any,
) -> AsyncIterator[Client]:
    """A connected client, from the address `source` if it is not the server's; `configuration` goes to aioquic.

    Without a `certificate` it takes every server's.
    """
    config = QuicConfiguration(
        alpn_protocols=H3_ALPN,
        max_datagram_frame_size=65536,
        server_name="localhost",
        verify_mode=ssl.CERT_REQUIRED if certificate else ssl.CERT_NONE,
        cadata=certificate.pem if certificate else None,
        session_ticket=ticket,
        **configuration,
    )
    loop = asyncio.get_running_loop()
    quic = QuicConnection(configuration=config, session_ticket_handler=on_ticket)
    _, client = await loop.create_datagram_endpoint(
        lambda: Client(quic), family=socket.AF_INET6 if ":" in host else socket.AF_INET, local_addr=(source or host, 0)
    )
    try:
        client.connect((host, port) if "." in host else (host, port, 0, 0), transmit=wait)
        if wait:
            await client.wait_connected()
        yield client
    finally:
        client.close()
        if client._timer is not None:
            client._timer.cancel()
        assert client._transport is not None
        client._transport.close()  # which may be another than at first


def request_body(**changes: Any) -> bytes:
    """A RenderRequest's JSON, with changes."""
    request = render_request(profile=None).model_dump(mode="json", exclude_unset=True, exclude_none=True)
    return json.dumps(request | changes).encode()


class Recorder:
    """What has happened on the server's side, for a test to wait for."""

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
