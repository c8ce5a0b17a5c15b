"""The package's HTTP/3 client from a chosen address, for the polite and for the hostile."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from typing import Any

from aioquic.quic.connection import QuicConnection

from benchmarks.hostile.services import SCENE
from tigas import http3
from tigas.http3 import WEBTRANSPORT_CANCELLED, Http3Connection, Protocol, configuration

HANDSHAKE_S = 10
FAR = 2.5
"""From the scene's centre, in scene units."""
EXPERIMENT = {"file": f'name = "hostile"\nscenes = ["{SCENE}"]\nmovements = ["stroll"]\nnetworks = ["unshaped"]'}
RUN = f"{SCENE}_stroll_unshaped_stateless-seen_0"
"""The name of its only run."""


def request(width: int = 320, height: int = 180, **changes: Any) -> dict[str, Any]:
    """A RenderRequest's fields: the scene from its front."""
    view = {"fx": width, "fy": width, "cx": width / 2, "cy": height / 2, "width": width, "height": height}
    return {"scene": SCENE, "position": [0, 0, -FAR], "quaternion": [0, 0, 0, 1], **view, **changes}


class Client(Http3Connection):
    """A connection that a polite or a hostile client uses."""

    @property
    def quic(self) -> QuicConnection:
        """Its QUIC connection, for attacks on that."""
        return self._quic

    async def session(self) -> int:
        """A new WebTransport session's id. Raises ConnectionError if it is refused."""
        session = await self.connect_webtransport()
        status = self.responses[session].status
        if status != 200:
            raise ConnectionRefusedError(f"the session was refused with status {status}")
        return session

    async def frame_status(self, session: int, request: bytes) -> int:
        """The status in the header of a frame, which is read whole."""
        header, _ = await self.frame(session, request)
        return int(header["status"])

    def reset(self, stream_id: int) -> None:
        """Withdraw a request, and refuse its answer."""
        self.quic.reset_stream(stream_id, WEBTRANSPORT_CANCELLED)
        self.stop(stream_id)

    def raw(self, stream_id: int, data: bytes) -> None:
        """Send bytes on a stream unchanged."""
        self._check()
        self.quic.send_stream_data(stream_id, data)
        self.transmit()


@asynccontextmanager
async def connect_as(kind: type[Protocol], port: int, address: str, **changes: Any) -> AsyncIterator[Protocol]:
    """A connection from an address of this machine. Raises ConnectionError and TimeoutError."""
    quic = QuicConnection(configuration=configuration(**changes))
    async with AsyncExitStack() as stack:
        async with asyncio.timeout(HANDSHAKE_S):
            client = await stack.enter_async_context(http3.connect(kind, ("127.0.0.1", port), quic, source=address))
        yield client


def connect(port: int, address: str, **changes: Any) -> AbstractAsyncContextManager[Client]:
    """A connected client from an address of this machine. Raises ConnectionError and TimeoutError."""
    return connect_as(Client, port, address, **changes)
