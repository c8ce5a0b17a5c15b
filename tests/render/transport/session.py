"""A client in a render session with a server."""

from __future__ import annotations

import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from tests.render.transport.client import CERTIFICATE, Client, FakeFrames, connect
from tigas_render.admission.limits import Limits
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server


async def no_app(*_: object) -> None:
    raise NotImplementedError


@asynccontextmanager
async def served(
    source: FakeFrames, limits: Limits | None = None, *, max_datagram: int = 65536
) -> AsyncIterator[tuple[Http3Server, Client, int]]:
    sessions = {"/render": render_session(source)}
    async with (
        Http3Server(no_app, host="127.0.0.1", certificate=CERTIFICATE, webtransport=sessions, limits=limits) as server,
        connect(server.port, max_datagram=max_datagram) as client,
    ):
        yield server, client, await client.connect_webtransport()


def assemble(datagrams: list[bytes]) -> dict[int, bytes | None]:
    """The frames that datagrams carry, by seq; None where a fragment is missing."""
    parts: dict[int, dict[int, bytes]] = {}
    counts: dict[int, int] = {}
    for datagram in datagrams:
        seq, number, count = struct.unpack_from("!IHH", datagram)
        parts.setdefault(seq, {})[number] = datagram[8:]
        counts[seq] = count
    return {
        seq: b"".join(numbered[n] for n in range(counts[seq])) if len(numbered) == counts[seq] else None
        for seq, numbered in parts.items()
    }


def arrived(client: Client, seq: int) -> bytes | None:
    return assemble(client.datagrams).get(seq)
