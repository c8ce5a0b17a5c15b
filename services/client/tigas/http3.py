"""An HTTP/3 and WebTransport client, which identifies the server by its certificate's digest."""

from __future__ import annotations

import asyncio
import base64
import json
import socket
import ssl
import struct
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

import httpx
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, ErrorCode, H3Connection
from aioquic.h3.events import DataReceived, H3Event, HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import ConnectionTerminated, QuicEvent, StopSendingReceived, StreamDataReceived, StreamReset
from cryptography.hazmat.primitives import hashes

CONNECT_S = 3.0
"""Timeout of the handshake in seconds, as a network that drops UDP does not answer."""
WEBTRANSPORT_CANCELLED = 0x52E4A40FA8DB
"""Application error code 0 as an HTTP/3 error code (draft-ietf-webtrans-http3), as sent by Chromium."""
Fields = Iterable[tuple[bytes, bytes]]
Protocol = TypeVar("Protocol", bound=QuicConnectionProtocol)


class Http3Failed(ConnectionError):
    """The connection could not be established, or has ended."""


@dataclass(slots=True)
class Response:
    """Data received on one stream so far."""

    fields: list[tuple[bytes, bytes]] = field(default_factory=list)
    body: bytearray = field(default_factory=bytearray)
    ended: bool = False
    reset: int | None = None
    stopped: int | None = None

    @property
    def done(self) -> bool:
        """Whether no more data can arrive."""
        return self.ended or self.reset is not None

    @property
    def headers(self) -> dict[bytes, bytes]:
        """Fields of the header section."""
        return dict(self.fields)

    @property
    def status(self) -> int:
        """HTTP status; 0 before it has arrived."""
        return int(self.headers.get(b":status", 0))


class Http3Connection(QuicConnectionProtocol):
    """A connection that collects responses per stream; `until` waits for a condition on them."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.h3 = H3Connection(self._quic, enable_webtransport=True)
        self.responses: dict[int, Response] = defaultdict(Response)
        self.is_closed = False
        self._webtransport_streams: set[int] = set()
        self._withdrawn: set[int] = set()
        """Streams with abandoned responses, until they end."""
        self._news = asyncio.Event()

    @property
    def certificate_sha256(self) -> str:
        """Base64 of the SHA-256 of the server's certificate."""
        certificate = self._quic.tls._peer_certificate  # aioquic has no public name for it
        return base64.b64encode(certificate.fingerprint(hashes.SHA256())).decode() if certificate else ""

    def quic_event_received(self, event: QuicEvent) -> None:
        """Collect an event's data, and wake waiting requests."""
        match event:
            case StreamDataReceived() | StreamReset() if event.stream_id in self._withdrawn:
                if isinstance(event, StreamReset) or event.end_stream:
                    self._withdrawn.remove(event.stream_id)
                return
            case ConnectionTerminated():
                self.is_closed = True
            case StreamReset():
                self.responses[event.stream_id].reset = event.error_code
            case StopSendingReceived():
                self.responses[event.stream_id].stopped = event.error_code
        if isinstance(event, StreamDataReceived) and event.stream_id in self._webtransport_streams:
            # aioquic would parse the answer on the client's own WebTransport stream as HTTP/3 frames
            self._received(event.stream_id, event.data, event.end_stream)
        else:
            for each in self.h3.handle_event(event):
                self.http_event_received(each)
        self._news.set()

    def close(self, *args: Any, **options: Any) -> None:
        """Close the connection, and stop waiting for responses."""
        super().close(*args, **options)
        self.is_closed = True
        self._news.set()

    def http_event_received(self, event: H3Event) -> None:
        """Collect headers and data."""
        if isinstance(event, HeadersReceived):
            self.responses[event.stream_id].fields += event.headers
            self._received(event.stream_id, b"", event.stream_ended)
        elif isinstance(event, DataReceived | WebTransportStreamDataReceived):
            self._received(event.stream_id, event.data, event.stream_ended)

    def _received(self, stream_id: int, data: bytes, ended: bool) -> None:
        response = self.responses[stream_id]
        response.body += data
        response.ended |= ended

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until an event makes a condition true."""
        while not condition():
            self._news.clear()
            await self._news.wait()

    async def response(self, stream_id: int) -> Response:
        """The whole response, or the part that arrived before it was reset. Raises Http3Failed."""
        response = self.responses[stream_id]
        await self.until(lambda: response.done or self.is_closed)
        if not response.done:
            raise Http3Failed("The connection was closed.")
        return response

    # -- HTTP --------------------------------------------------------------------------------------------------------

    def request(
        self, method: str, path: str, body: bytes | None = None, headers: Fields = (), *, authority: str = "localhost"
    ) -> int:
        """Send a complete request, and return its stream's id."""
        stream_id = self.open_request(method, path, headers, authority=authority, end=body is None)
        if body is not None:
            self.h3.send_data(stream_id, body, end_stream=True)
            self.transmit()
        return stream_id

    def open_request(
        self, method: str, path: str, headers: Fields = (), *, authority: str = "localhost", end: bool = False
    ) -> int:
        """Send a request's header section, and return its stream's id."""
        self._check()
        stream_id = self._quic.get_next_available_stream_id()
        pseudo = {":method": method, ":scheme": "https", ":authority": authority, ":path": path}
        fields = [(name.encode(), value.encode()) for name, value in pseudo.items()]
        self.h3.send_headers(stream_id, [*fields, *headers], end_stream=end)
        self.transmit()
        return stream_id

    async def post(self, authority: str, path: str, body: bytes) -> httpx.Response:
        """Send a POST request, and return the whole answer. Raises Http3Failed. Cancelling it cancels the request."""
        headers = ((b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()))
        stream_id = self.request("POST", path, body, headers, authority=authority)
        try:
            response = await self.response(stream_id)
        except asyncio.CancelledError:
            self._withdraw(stream_id, ErrorCode.H3_REQUEST_CANCELLED)
            raise
        finally:
            self.responses.pop(stream_id, None)
        if response.reset is not None:
            raise Http3Failed("The server reset the request.")
        fields = [each for each in response.fields if not each[0].startswith(b":")]
        extensions = {"http_version": b"HTTP/3"}
        return httpx.Response(
            response.status or 502, headers=fields, content=bytes(response.body), extensions=extensions
        )

    # -- WebTransport ------------------------------------------------------------------------------------------------

    async def connect_webtransport(
        self, path: str = "/render", authority: str = "localhost", origin: str | None = None
    ) -> int:
        """Open a session; returns its id and the response's status. Raises Http3Failed."""
        headers = [] if origin is None else [(b"origin", origin.encode())]
        protocol = (b":protocol", b"webtransport")
        session = self.open_request("CONNECT", path, [protocol, *headers], authority=authority)
        await self.until(lambda: self.responses[session].status or self.is_closed)
        if not self.responses[session].status:
            raise Http3Failed("The connection was closed.")
        return session

    def open_stream(self, session: int, data: bytes = b"", end: bool = True) -> int:
        """Send data on a new stream of a session, and return the stream's id."""
        self._check()
        stream_id = self.h3.create_webtransport_stream(session)
        self._webtransport_streams.add(stream_id)
        self._quic.send_stream_data(stream_id, data, end)
        self.transmit()
        return stream_id

    def stop(self, stream_id: int) -> None:
        """Send STOP_SENDING, like a page that cancels its reader."""
        self._check()
        self._quic.stop_stream(stream_id, WEBTRANSPORT_CANCELLED)
        self.transmit()

    async def frame(self, session: int, request: bytes) -> tuple[dict[str, Any], bytes]:
        """Request a frame; returns the FrameHeader's fields and the body. Cancellable. Raises Http3Failed."""
        stream_id = self.open_stream(session, request)
        try:
            response = await self.response(stream_id)
        except asyncio.CancelledError:
            self._withdraw(stream_id, WEBTRANSPORT_CANCELLED)
            raise
        finally:
            self.responses.pop(stream_id, None)
            self._webtransport_streams.discard(stream_id)
        if response.reset is not None:
            raise Http3Failed("The server reset the stream.")
        return split_frame(bytes(response.body))

    def _withdraw(self, stream_id: int, code: int) -> None:
        """Refuse the rest of a response, if any."""
        if not self.is_closed and not self.responses[stream_id].done:
            self._withdrawn.add(stream_id)
            self._quic.stop_stream(stream_id, code)
            self.transmit()

    def _check(self) -> None:
        if self.is_closed:
            raise Http3Failed("The connection was closed.")


def split_frame(answer: bytes) -> tuple[dict[str, Any], bytes]:
    """Split an answer into the FrameHeader's fields and the body."""
    (length,) = struct.unpack_from("!I", answer)
    return json.loads(answer[4 : 4 + length]), answer[4 + length :]


def configuration(**changes: Any) -> QuicConfiguration:
    """A client configuration that accepts any certificate unless changed."""
    usual = {"server_name": "localhost", "verify_mode": ssl.CERT_NONE, "max_datagram_frame_size": 65536}
    return QuicConfiguration(alpn_protocols=H3_ALPN, **{**usual, **changes})


@asynccontextmanager
async def connect(
    create: Callable[..., Protocol],
    address: tuple[str, int],
    quic: QuicConnection,
    *,
    source: str | None = None,
    wait: bool = True,
) -> AsyncIterator[Protocol]:
    """Connect to an IP address, from the local address `source` if given."""
    host, port = address
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    local = source or ("::" if family == socket.AF_INET6 else "0.0.0.0")
    loop = asyncio.get_running_loop()
    _, client = await loop.create_datagram_endpoint(lambda: create(quic), family=family, local_addr=(local, 0))
    try:
        client.connect((host, port, 0, 0) if family == socket.AF_INET6 else (host, port), transmit=wait)
        if wait:
            await client.wait_connected()
        yield client
    finally:
        client.close()
        if client._timer is not None:
            client._timer.cancel()
        assert client._transport is not None
        client._transport.close()  # it may have been replaced since


@asynccontextmanager
async def connected(authority: str, certificate_sha256: str) -> AsyncIterator[Http3Connection]:
    """Connect to HOST:PORT with a certificate of this digest. Raises Http3Failed."""
    url = urlsplit(f"//{authority}")
    # Only the digest, received over HTTP, authenticates the certificate.
    quic = QuicConnection(configuration=configuration(server_name=url.hostname))
    async with AsyncExitStack() as stack:
        try:
            async with asyncio.timeout(CONNECT_S):
                loop = asyncio.get_running_loop()
                found = await loop.getaddrinfo(url.hostname, url.port or 443, type=socket.SOCK_DGRAM)
                host, port = found[0][4][:2]
                connection = await stack.enter_async_context(connect(Http3Connection, (str(host), int(port)), quic))
        except (OSError, TimeoutError):
            raise Http3Failed from None
        if connection.certificate_sha256 != certificate_sha256:
            raise Http3Failed
        yield connection
