"""Requests over an HTTP/3 connection to a server that is known by its certificate's digest. Needs aioquic."""

from __future__ import annotations

import asyncio
import base64
import ssl
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, cast
from urllib.parse import urlsplit

import httpx
from aioquic.asyncio.client import connect
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, ErrorCode, H3Connection
from aioquic.h3.events import DataReceived, HeadersReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import ConnectionTerminated, QuicEvent, StreamReset
from cryptography.hazmat.primitives import hashes

CONNECT_S = 3.0
"""For the handshake: a network that drops UDP says nothing."""


class Http3Failed(Exception):
    """The connection cannot be made, or is gone."""


@dataclass(slots=True)
class _Request:
    """What has come on its stream."""

    answered: asyncio.Future[httpx.Response]
    headers: list[tuple[bytes, bytes]] = field(default_factory=list)
    body: bytearray = field(default_factory=bytearray)

    def finish(self) -> None:
        status = int(dict(self.headers).get(b":status", b"502"))
        fields = [each for each in self.headers if not each[0].startswith(b":")]
        if not self.answered.done():
            self.answered.set_result(
                httpx.Response(status, headers=fields, content=bytes(self.body), extensions={"http_version": b"HTTP/3"})
            )

    def fail(self) -> None:
        if not self.answered.done():
            self.answered.set_exception(Http3Failed())


class Http3Connection(QuicConnectionProtocol):
    """Sends requests and gathers their answers."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._h3 = H3Connection(self._quic)
        self._requests: dict[int, _Request] = {}
        self.is_closed = False

    @property
    def certificate_sha256(self) -> str:
        """Base64 of the SHA-256 of the server's certificate."""
        certificate = self._quic.tls._peer_certificate  # aioquic has no public name for it
        return base64.b64encode(certificate.fingerprint(hashes.SHA256())).decode() if certificate else ""

    async def post(self, authority: str, path: str, body: bytes) -> httpx.Response:
        """The whole answer. Raises Http3Failed. If it is cancelled, so is the request."""
        if self.is_closed:
            raise Http3Failed
        stream_id = self._quic.get_next_available_stream_id()
        headers = [
            (b":method", b"POST"),
            (b":scheme", b"https"),
            (b":authority", authority.encode()),
            (b":path", path.encode()),
            (b"content-type", b"application/json"),
            (b"content-length", str(len(body)).encode()),
        ]
        self._h3.send_headers(stream_id, headers)
        self._h3.send_data(stream_id, body, end_stream=True)
        self.transmit()
        request = self._requests[stream_id] = _Request(asyncio.get_running_loop().create_future())
        try:
            return await request.answered
        except asyncio.CancelledError:
            if request.answered.cancelled() and not self.is_closed:
                self._quic.stop_stream(stream_id, ErrorCode.H3_REQUEST_CANCELLED)
                self.transmit()
            raise
        finally:
            del self._requests[stream_id]

    def quic_event_received(self, event: QuicEvent) -> None:
        """aioquic tells of something."""
        if isinstance(event, ConnectionTerminated):
            self.is_closed = True
            for request in self._requests.values():
                request.fail()
        elif isinstance(event, StreamReset) and event.stream_id in self._requests:
            self._requests[event.stream_id].fail()
        for told in self._h3.handle_event(event):
            if not isinstance(told, HeadersReceived | DataReceived) or told.stream_id not in self._requests:
                continue
            request = self._requests[told.stream_id]
            if isinstance(told, HeadersReceived):
                request.headers += told.headers
            else:
                request.body += told.data
            if told.stream_ended:
                request.finish()


@asynccontextmanager
async def connected(authority: str, certificate_sha256: str) -> AsyncIterator[Http3Connection]:
    """A connection to HOST:PORT, whose certificate must have this digest. Raises Http3Failed."""
    address = urlsplit(f"//{authority}")
    # Nobody vouches for the certificate but the digest, which came over HTTP.
    configuration = QuicConfiguration(alpn_protocols=H3_ALPN, verify_mode=ssl.CERT_NONE)
    async with AsyncExitStack() as stack:
        try:
            async with asyncio.timeout(CONNECT_S):
                connecting = connect(
                    address.hostname or "",
                    address.port or 443,
                    configuration=configuration,
                    create_protocol=Http3Connection,
                )
                connection = cast(Http3Connection, await stack.enter_async_context(connecting))
        except (OSError, TimeoutError):
            raise Http3Failed from None
        if connection.certificate_sha256 != certificate_sha256:
            raise Http3Failed
        yield connection
