"""An HTTP/3 and WebTransport client from an address of one's choice, for the polite and for the hostile."""

from __future__ import annotations

import asyncio
import ssl
import struct
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, TypeVar

from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DataReceived, HeadersReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import ConnectionTerminated, QuicEvent, StreamDataReceived, StreamReset

from benchmarks.hostile.services import SCENE

HANDSHAKE_S = 10
FAR = 2.5
"""From the scene's centre, in scene units."""
CANCELLED = 0x52E4A40FA8DB
Protocol = TypeVar("Protocol", bound=QuicConnectionProtocol)


def request(width: int = 320, height: int = 180, **changes: Any) -> dict[str, Any]:
    """A RenderRequest's fields: the scene from its front."""
    view = {"fx": width, "fy": width, "cx": width / 2, "cy": height / 2, "width": width, "height": height}
    return {"scene": SCENE, "position": [0, 0, -FAR], "quaternion": [0, 0, 0, 1], **view, **changes}


def pseudo(method: str, path: str) -> list[tuple[bytes, bytes]]:
    """The first fields of a request."""
    fields = {":method": method, ":scheme": "https", ":authority": "localhost", ":path": path}
    return [(name.encode(), value.encode()) for name, value in fields.items()]


class Client(QuicConnectionProtocol):
    """One connection. What breaks ends those who wait with a ConnectionError."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.quic = self._quic
        self.h3 = H3Connection(self._quic, enable_webtransport=True)
        self.closed = False
        self._waiting: dict[int, asyncio.Future[bytes]] = {}
        self._bodies: dict[int, bytearray] = {}
        self._frames: set[int] = set()
        self._sessions: set[int] = set()

    def quic_event_received(self, event: QuicEvent) -> None:
        match event:
            case ConnectionTerminated():
                self.closed = True
                for stream_id in list(self._waiting):
                    self._fail(stream_id)
            case StreamReset():
                self._fail(event.stream_id)
            case StreamDataReceived() if event.stream_id in self._frames:
                # aioquic takes the answer on a stream of the client's own for HTTP/3 frames
                self._received(event.stream_id, event.data, event.end_stream)
                return
        for h3_event in self.h3.handle_event(event):
            match h3_event:
                case HeadersReceived():
                    status = dict(h3_event.headers)[b":status"]
                    ended = h3_event.stream_ended or h3_event.stream_id in self._sessions
                    self._received(h3_event.stream_id, status, ended)
                case DataReceived():
                    self._received(h3_event.stream_id, h3_event.data, h3_event.stream_ended)

    def _received(self, stream_id: int, data: bytes, ended: bool) -> None:
        if stream_id not in self._waiting:
            return
        body = self._bodies.setdefault(stream_id, bytearray())
        body += data
        if ended:
            self._answered(stream_id, bytes(body))

    def _answered(self, stream_id: int, body: bytes) -> None:
        future = self._forget(stream_id)
        if future is not None and not future.done():
            future.set_result(body)

    def _fail(self, stream_id: int) -> None:
        future = self._forget(stream_id)
        if future is not None and not future.done():
            future.set_exception(ConnectionResetError("the server has ended it"))

    def _forget(self, stream_id: int) -> asyncio.Future[bytes] | None:
        self._bodies.pop(stream_id, None)
        self._frames.discard(stream_id)
        return self._waiting.pop(stream_id, None)

    # -- asking ------------------------------------------------------------------------------------------------------

    async def session(self) -> int:
        """A new WebTransport session's id. Raises ConnectionError if it is refused."""
        stream_id = self.quic.get_next_available_stream_id()
        fields = pseudo("CONNECT", "/render")
        fields.insert(1, (b":protocol", b"webtransport"))
        self._sessions.add(stream_id)
        answer = self._ask(stream_id)
        self.h3.send_headers(stream_id, fields)
        self.transmit()
        status = await answer
        if not status.startswith(b"200"):
            raise ConnectionRefusedError(f"the session was refused with status {status[:3].decode()}")
        return stream_id

    def send(self, session: int, body: bytes, *, end: bool = True) -> int:
        """Ask for a frame, and do not wait; the stream's id."""
        self._check()
        stream_id = self.h3.create_webtransport_stream(session)
        self.quic.send_stream_data(stream_id, body, end)
        self.transmit()
        return stream_id

    async def frame(self, session: int, body: bytes) -> int:
        """Ask for a frame and read it; the status in its header."""
        self._check()
        stream_id = self.h3.create_webtransport_stream(session)
        self._frames.add(stream_id)
        answer = self._ask(stream_id)
        self.quic.send_stream_data(stream_id, body, True)
        self.transmit()
        data = await answer
        (length,) = struct.unpack_from("!I", data)
        return int(data[4 : 4 + length].split(b'"status":', 1)[1].split(b",", 1)[0])

    def cancel(self, stream_id: int) -> None:
        """Want no answer on a stream any more."""
        self._check()
        self.quic.stop_stream(stream_id, CANCELLED)
        self.transmit()

    def raw(self, stream_id: int, data: bytes) -> None:
        """Send bytes on a stream as they are."""
        self._check()
        self.quic.send_stream_data(stream_id, data)
        self.transmit()

    def _ask(self, stream_id: int) -> asyncio.Future[bytes]:
        self._check()
        answer = self._waiting[stream_id] = asyncio.get_running_loop().create_future()
        return answer

    def _check(self) -> None:
        if self.closed:
            raise ConnectionAbortedError("the connection is closed")


def configuration(**changes: Any) -> QuicConfiguration:
    """A client's, which trusts every certificate."""
    return QuicConfiguration(
        alpn_protocols=H3_ALPN,
        max_datagram_frame_size=65536,
        server_name="localhost",
        verify_mode=ssl.CERT_NONE,
        **changes,
    )


@asynccontextmanager
async def connect_as(kind: type[Protocol], port: int, address: str, **changes: Any) -> AsyncIterator[Protocol]:
    """A connection from an address of this machine. Raises ConnectionError and TimeoutError."""
    loop = asyncio.get_running_loop()
    quic = QuicConnection(configuration=configuration(**changes))
    transport, client = await loop.create_datagram_endpoint(lambda: kind(quic), local_addr=(address, 0))
    try:
        client.connect(("127.0.0.1", port))
        async with asyncio.timeout(HANDSHAKE_S):
            await client.wait_connected()
        yield client
    finally:
        client.close()
        if client._timer is not None:
            client._timer.cancel()
        transport.close()


def connect(port: int, address: str, **changes: Any) -> AbstractAsyncContextManager[Client]:
    """A connected client from an address of this machine. Raises ConnectionError and TimeoutError."""
    return connect_as(Client, port, address, **changes)
