"""HTTP/3 servers for tests, and what a client gets from them."""

from __future__ import annotations

import contextlib
import math
import struct
import time
from collections.abc import AsyncIterator

from starlette.types import ASGIApp, Receive, Scope, Send

from tests.render.transport.client import CERTIFICATE, Client, FakeFrames, connect
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import RequestRate
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server


async def hello(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": scope["path"].encode()})


@contextlib.asynccontextmanager
async def served(
    limits: Limits | None = None,
    source: FakeFrames | None = None,
    *,
    app: ASGIApp = hello,
    load: Load | None = None,
    most_requests_per_s: float = math.inf,
) -> AsyncIterator[Http3Server]:
    load = load or Load()
    sessions = {
        "/render": render_session(source or FakeFrames(), RequestRate(load, most_requests_per_s, time.monotonic))
    }
    async with Http3Server(
        app, host="127.0.0.1", certificate=CERTIFICATE, webtransport=sessions, limits=limits, load=load
    ) as server:
        yield server


@contextlib.asynccontextmanager
async def in_session(
    source: FakeFrames, limits: Limits | None = None, *, max_datagram: int = 65536
) -> AsyncIterator[tuple[Http3Server, Client, int]]:
    """A client in a render session with a server."""
    async with served(limits, source) as server, connect(server.port, max_datagram=max_datagram) as client:
        yield server, client, await client.connect_webtransport()


def assemble(datagrams: list[bytes]) -> dict[int, bytes | None]:
    """The frames that datagrams carry, by seq; None where a fragment is missing."""
    parts: dict[int, dict[int, bytes]] = {}
    counts: dict[int, int] = {}
    for datagram in datagrams:
        seq, number, counts[seq] = struct.unpack_from("!IHH", datagram)
        parts.setdefault(seq, {})[number] = datagram[8:]
    return {
        seq: b"".join(numbered[n] for n in range(counts[seq])) if len(numbered) == counts[seq] else None
        for seq, numbered in parts.items()
    }


async def in_datagrams(client: Client, seq: int) -> bytes:
    """The answer with this number, once it is complete."""
    await client.until(lambda: assemble(client.datagrams).get(seq))
    return assemble(client.datagrams)[seq] or b""
