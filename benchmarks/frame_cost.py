"""The processor time that each frame costs the server: our transport against a stock aioquic server, in the same run.

    python -m benchmarks.frame_cost [--blocks 5] [--seconds 1] [--bytes 23000 197000] [--over webtransport post]

Both servers answer from memory, each in its own process, and take turns block by block; one client process asks over
loopback, a frame at a time for each viewer. Their time is that of the process's own clock (user and system) over the
frames of a block. "Stock" is what aioquic's examples do, as in `benchmarks.transport`: it reads no request. Ours does
all that the render service does but rendering; `post` goes through its HTTP application.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import math
import random
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import uvloop
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.asyncio.server import serve
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DataReceived, HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import ProtocolNegotiated, QuicEvent

from benchmarks.hostile.client import Client as HttpClient
from benchmarks.hostile.client import connect_as, pseudo, request
from tigas_common.certificate import Certificate
from tigas_common.memory import give_back_regularly
from tigas_common.origins import OriginPolicy
from tigas_common.wire.render import FrameHeader, RenderRequest, ServerTiming
from tigas_render.app import create_app
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.transport.frames import render_session
from tigas_render.transport.http_viewers import HttpViewers
from tigas_render.transport.load import Load
from tigas_render.transport.request_rate import RequestRate
from tigas_render.transport.server import Http3Server

VIEWERS = 4
WARM_UP_FRAMES = 30
"""Of each viewer, until the congestion window has grown."""
TIMING = ServerTiming(queue=0, render=0, encode=0)
REQUEST = json.dumps(request(1280, 720, profile=0, deadline_ms=1000)).encode()


class Memory(FrameSource):
    """A FrameSource that has every frame already."""

    def __init__(self, size: int) -> None:
        self.body = bytes(size)

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        frame = Frame(self.body, "jpeg", 1280, 720, request.seq, request.profile, TIMING)
        return asyncio.get_running_loop().call_soon(answered, frame).cancel


# -- servers ---------------------------------------------------------------------------------------------------------


async def run_ours(certificate: Certificate, size: int) -> None:
    source = Memory(size)
    rate = RequestRate(Load(), math.inf, time.monotonic)
    viewers = HttpViewers(Load(), time.monotonic)
    service = SimpleNamespace(origins=OriginPolicy(), http_viewers=viewers, rate=rate, submit=source.submit)
    app = create_app(service)  # type: ignore[arg-type]
    sessions = {"/render": render_session(source)}
    async with Http3Server(app, host="127.0.0.1", certificate=certificate, webtransport=sessions) as server:
        memory = asyncio.create_task(give_back_regularly())  # as the service does
        await asyncio.sleep(0)
        print(server.port, flush=True)
        await memory


async def run_stock(certificate: Certificate, size: int) -> None:
    header = FrameHeader(status=200, seq=0, content_type="image/jpeg", width=1280, height=720, timing=TIMING)
    text = header.model_dump_json().encode()
    body = bytes(size)
    answer = struct.pack("!I", len(text)) + text + body

    class Stock(QuicConnectionProtocol):
        http: H3Connection | None = None
        posts: set[int]

        def quic_event_received(self, event: QuicEvent) -> None:
            if isinstance(event, ProtocolNegotiated):
                self.http = H3Connection(self._quic, enable_webtransport=True)
                self.posts = set()
            for h3_event in self.http.handle_event(event) if self.http is not None else ():
                self.answer(self.http, h3_event)
            self.transmit()

        def answer(self, http: H3Connection | None, event: Any) -> None:
            assert http is not None
            match event:
                case HeadersReceived() if dict(event.headers)[b":method"] == b"CONNECT":
                    headers = [(b":status", b"200"), (b"sec-webtransport-http3-draft", b"draft02")]
                    http.send_headers(event.stream_id, headers)
                case DataReceived() if event.stream_ended:
                    http.send_headers(event.stream_id, [(b":status", b"200"), (b"content-type", b"image/jpeg")])
                    http.send_data(event.stream_id, body, end_stream=True)
                case WebTransportStreamDataReceived() if event.stream_ended:
                    self._quic.send_stream_data(event.stream_id, answer, end_stream=True)

    configuration = QuicConfiguration(
        is_client=False,
        alpn_protocols=H3_ALPN,
        max_datagram_frame_size=65536,
        certificate=certificate.x509,
        private_key=certificate.private_key,
    )
    server = await serve("127.0.0.1", 0, configuration=configuration, create_protocol=Stock)
    assert server._transport is not None
    print(server._transport.get_extra_info("sockname")[1], flush=True)
    await asyncio.Event().wait()


def run_server(name: str, size: int) -> None:
    certificate = Certificate.create([], datetime.now(UTC))
    if name == "stock":
        asyncio.run(run_stock(certificate, size))
    else:
        uvloop.run(run_ours(certificate, size))


@dataclass(frozen=True)
class Server:
    """One that runs."""

    pid: int
    port: int

    def cpu_seconds(self) -> float:
        """The process's own clock, as clock_getcpuclockid(3) makes its id."""
        return time.clock_gettime((~self.pid << 3) | 2)


@contextlib.contextmanager
def server_process(name: str, size: int) -> Iterator[Server]:
    command = [sys.executable, "-m", "benchmarks.frame_cost", "--serve", name, "--bytes", str(size)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield Server(process.pid, int(process.stdout.readline()))
    finally:
        process.terminate()
        process.wait()


# -- the client ------------------------------------------------------------------------------------------------------


class Viewer(HttpClient):
    """One connection."""

    async def post(self) -> None:
        """A frame by POST. Raises RuntimeError for any other answer."""
        stream_id = self.quic.get_next_available_stream_id()
        answer = self._ask(stream_id)
        self.h3.send_headers(stream_id, pseudo("POST", "/render"))
        self.h3.send_data(stream_id, REQUEST, end_stream=True)
        self.transmit()
        if not (await answer).startswith(b"200"):
            raise RuntimeError("A request was refused.")

    async def view(self, session: int) -> None:
        """A frame over WebTransport. Raises RuntimeError for any other answer."""
        if await self.frame(session, REQUEST) != 200:
            raise RuntimeError("A request was refused.")


Ask = Callable[[], Coroutine[None, None, object]]


async def asking(viewer: Viewer, over: str) -> Ask:
    """What asks for a frame and reads it."""
    if over == "post":
        return viewer.post
    session = await viewer.session()
    return lambda: viewer.view(session)


@contextlib.asynccontextmanager
async def viewers(server: Server, over: str) -> AsyncIterator[list[Ask]]:
    async with contextlib.AsyncExitStack() as stack:
        window = {"max_data": 1 << 24, "max_stream_data": 1 << 24}
        connected = [
            await stack.enter_async_context(connect_as(Viewer, server.port, "127.0.0.1", **window))
            for _ in range(VIEWERS)
        ]
        yield [await asking(viewer, over) for viewer in connected]


async def frames(asks: list[Ask], go_on: Callable[[int], bool]) -> int:
    """Each asks again and again, while it may by how many it has had; how many all have had."""

    async def view(ask: Ask) -> int:
        count = 0
        while go_on(count):
            await ask()
            count += 1
        return count

    return sum(await asyncio.gather(*map(view, asks)))


async def measure(servers: dict[str, Server], over: str, blocks: int, seconds: float) -> dict[str, list[float]]:
    """Microseconds a frame in each block."""
    costs: dict[str, list[float]] = {name: [] for name in servers}
    async with contextlib.AsyncExitStack() as stack:
        asks = {name: await stack.enter_async_context(viewers(server, over)) for name, server in servers.items()}
        for each in asks.values():
            await frames(each, lambda count: count < WARM_UP_FRAMES)
        for _ in range(blocks):
            for name, server in servers.items():
                until = time.monotonic() + seconds
                before = server.cpu_seconds()
                count = await frames(asks[name], lambda _, until=until: time.monotonic() < until)  # type: ignore[misc]
                costs[name].append((server.cpu_seconds() - before) / count * 1e6)
    return costs


def interval(values: list[float]) -> str:
    """The mean, and where it lies with 95 % by the bootstrap over blocks."""
    generator = random.Random(0)
    means = sorted(statistics.fmean(generator.choices(values, k=len(values))) for _ in range(2000))
    three = statistics.fmean(values), means[50], means[-51]
    mean, low, high = (f"{value:.0f}" if value >= 100 else f"{value:.2f}" for value in three)
    return f"{mean:>5} ({low} to {high})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--serve", choices=["ours", "stock"], help=argparse.SUPPRESS)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1, help="of a block")
    parser.add_argument("--bytes", type=int, nargs="+", default=[23_000, 197_000], help="of a frame")
    parser.add_argument("--over", nargs="+", choices=["webtransport", "post"], default=["webtransport", "post"])
    parser.add_argument("--servers", nargs="+", choices=["ours", "stock"], default=["stock", "ours"])
    arguments = parser.parse_args()
    if arguments.serve:
        run_server(arguments.serve, arguments.bytes[0])
        return
    print(f"µs of the server's processor a frame, mean of {arguments.blocks} blocks of {arguments.seconds:g} s (95 %)")
    for size in arguments.bytes:
        with contextlib.ExitStack() as stack:
            servers = {name: stack.enter_context(server_process(name, size)) for name in arguments.servers}
            for over in arguments.over:
                costs = uvloop.run(measure(servers, over, arguments.blocks, arguments.seconds))
                about = f"{size:9,} bytes  {over:12}"
                for name, each in costs.items():
                    print(f"{about}  {name:5} {interval(each)}")
                if len(costs) == 2:
                    ratios = [ours / stock for ours, stock in zip(costs["ours"], costs["stock"], strict=True)]
                    print(f"{about}  ratio {interval(ratios)}", flush=True)


if __name__ == "__main__":
    main()
