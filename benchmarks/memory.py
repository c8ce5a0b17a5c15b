"""Resident memory of the server's process while frames go out: it must stay flat, over one connection and over many.

    python -m benchmarks.memory [--frames 20000] [--connections 200] [--bytes 20000] [--seconds 300]

The server answers from memory in a process of its own, so what grows is the transport's. Exits with 1 if resident
memory grows by more than 20 MB after the warm-up.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ssl
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from datetime import UTC, datetime
from typing import Any

import psutil
import uvloop
from aioquic.asyncio.client import connect
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import HeadersReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import QuicEvent, StreamDataReceived

from tigas_common.certificate import Certificate
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import RenderRequest, ServerTiming
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server

LIMIT_MB = 20
IN_FLIGHT = 4
AT_ONCE = 8
WARM_UP = 2000
TIMING = ServerTiming(queue=0, render=0, encode=0)
VIEW = RenderRequest.at("demo", Pose.from_euler(0, 0, 0, (0, 0, 0)), Intrinsics(300, 300, 160, 90, 320, 180))
REQUEST = VIEW.model_dump_json(exclude_none=True).encode()


class Memory(FrameSource):
    """A FrameSource that has every frame already."""

    def __init__(self, size: int) -> None:
        self.body = bytes(size)

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        frame = Frame(self.body, "jpeg", 320, 180, request.seq, request.profile, TIMING)
        return asyncio.get_running_loop().call_soon(answered, frame).cancel


async def serve(size: int) -> None:
    async def app(*_: Any) -> None:
        raise NotImplementedError

    certificate = Certificate.create([], datetime.now(UTC))
    sessions = {"/render": render_session(Memory(size))}
    async with Http3Server(app, host="127.0.0.1", certificate=certificate, webtransport=sessions) as server:
        print(server.port, flush=True)
        await asyncio.Event().wait()


@contextlib.contextmanager
def server_process(size: int) -> Iterator[tuple[int, psutil.Process]]:
    command = [sys.executable, "-m", "benchmarks.memory", "--serve", "--bytes", str(size)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline()), psutil.Process(process.pid)
        finally:
            process.terminate()


class Viewer(QuicConnectionProtocol):
    """Asks for frames over one WebTransport session and throws them away."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._h3 = H3Connection(self._quic, enable_webtransport=True)
        self._waiting: dict[int, asyncio.Future[None]] = {}
        self._frames: set[int] = set()
        self._session = 0

    def quic_event_received(self, event: QuicEvent) -> None:
        if isinstance(event, StreamDataReceived) and event.stream_id in self._frames:
            if event.end_stream:
                self._frames.remove(event.stream_id)
                self._waiting.pop(event.stream_id).set_result(None)
            return
        for h3_event in self._h3.handle_event(event):
            if isinstance(h3_event, HeadersReceived):
                self._waiting.pop(h3_event.stream_id).set_result(None)

    async def open(self) -> None:
        self._session = self._quic.get_next_available_stream_id()
        headers = [
            (b":method", b"CONNECT"),
            (b":protocol", b"webtransport"),
            (b":scheme", b"https"),
            (b":authority", b"localhost"),
            (b":path", b"/render"),
        ]
        self._h3.send_headers(self._session, headers)
        await self._answer(self._session)

    async def frame(self) -> None:
        stream_id = self._h3.create_webtransport_stream(self._session)
        self._frames.add(stream_id)
        self._quic.send_stream_data(stream_id, REQUEST, end_stream=True)
        await self._answer(stream_id)

    async def _answer(self, stream_id: int) -> None:
        self._waiting[stream_id] = self._loop.create_future()
        self.transmit()
        await self._waiting[stream_id]


@contextlib.asynccontextmanager
async def viewer(port: int) -> AsyncIterator[Viewer]:
    configuration = QuicConfiguration(
        alpn_protocols=H3_ALPN, max_datagram_frame_size=65536, verify_mode=ssl.CERT_NONE, server_name="localhost"
    )
    async with connect("127.0.0.1", port, configuration=configuration, create_protocol=Viewer) as client:
        assert isinstance(client, Viewer)
        await client.open()
        yield client


async def watch(port: int, frames: int, deadline: float) -> int:
    """One connection that gets so many frames, a few at a time; how many it got before the deadline."""
    got = 0
    async with viewer(port) as client:

        async def worker(share: int) -> None:
            nonlocal got
            for _ in range(share):
                if time.monotonic() > deadline:
                    return
                await client.frame()
                got += 1

        shares = [frames // IN_FLIGHT + (number < frames % IN_FLIGHT) for number in range(IN_FLIGHT)]
        await asyncio.gather(*map(worker, shares))
    return got


async def crowd(port: int, connections: int, frames: int, deadline: float) -> int:
    """So many connections, a few at a time, each of which gets so many frames; how many frames there were in all."""
    todo = iter(range(connections))

    async def one_after_another() -> int:
        return sum([await watch(port, frames, deadline) for _ in todo if time.monotonic() < deadline])

    return sum(await asyncio.gather(*(one_after_another() for _ in range(AT_ONCE))))


async def measure(name: str, port: int, process: psutil.Process, frames: int, connections: int, seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    each = max(1, frames // connections)
    await crowd(port, max(1, connections // 10), min(each, WARM_UP), deadline)
    before, start = process.memory_info().rss / 1e6, time.monotonic()
    got = await crowd(port, connections, each, deadline)
    after, elapsed = process.memory_info().rss / 1e6, time.monotonic() - start
    print(
        f"{name:16} {got:6,} frames, {connections} connections, {elapsed:5.1f} s:"
        f" {before:6.1f} MB before, {after:6.1f} MB after, {after - before:+.1f} MB",
        flush=True,
    )
    return after - before <= LIMIT_MB


async def main(arguments: argparse.Namespace) -> int:
    flat = True
    for name, connections in (("one connection", 1), ("many connections", arguments.connections)):
        with server_process(arguments.bytes) as (port, process):
            flat &= await measure(name, port, process, arguments.frames, connections, arguments.seconds)
    return 0 if flat else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--connections", type=int, default=200, help="of the second measurement")
    parser.add_argument("--bytes", type=int, default=20_000, help="of one frame")
    parser.add_argument("--seconds", type=float, default=300, help="limit for each measurement")
    options = parser.parse_args()
    if options.serve:
        uvloop.run(serve(options.bytes))
    else:
        sys.exit(uvloop.run(main(options)))
