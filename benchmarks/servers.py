"""Servers of frames from memory, each in a separate process: ours, and a stock aioquic server.

"Stock" means aioquic's examples: a default QuicConfiguration (1200-byte datagrams) on asyncio's loop, `serve`, one
`sendto` per packet; it parses no request. Ours does everything that an edge does for frames except fetching them from
the engine.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import psutil
import uvloop
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.asyncio.server import serve
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DataReceived, HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import ProtocolNegotiated, QuicEvent

from benchmarks.services import STOP_S
from tigas_common import processes
from tigas_common.resources import keep_releasing_memory
from tigas_common.wire.render import FrameHeader, RenderRequest, ServerTiming
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import HttpViewers, RequestRate
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.server.frame_route import HttpFrames, frames_app
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server

NAMES = ("stock", "ours")
LIMITS = Limits(handshakes_per_s=1000)
"""All clients have one address."""
TIMING = ServerTiming(queue=0, render=0, encode=0)


@dataclass(frozen=True)
class Server:
    """A running server."""

    pid: int
    port: int

    def cpu_seconds(self) -> float:
        """The process's own clock, as clock_getcpuclockid(3) makes its id."""
        return time.clock_gettime((~self.pid << 3) | 2)

    def megabytes(self) -> float:
        """Resident memory."""
        return float(psutil.Process(self.pid).memory_info().rss) / 1e6


@contextlib.contextmanager
def running(name: str, size: int) -> Iterator[Server]:
    """A server of frames of this many bytes."""
    command = [sys.executable, "-m", "benchmarks.servers", name, str(size)]
    with processes.run_process(command, STOP_S, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        yield Server(process.pid, int(process.stdout.readline()))


class Memory(FrameSource):
    """A FrameSource that has every frame already."""

    def __init__(self, size: int) -> None:
        self.body = bytes(size)

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        frame = Frame(self.body, "jpeg", 1280, 720, request.seq, request.profile, TIMING)
        return asyncio.get_running_loop().call_soon(on_answer, frame).cancel


async def run_ours(certificate: Certificate, size: int) -> None:
    source = Memory(size)
    rate = RequestRate(Load(), math.inf, time.monotonic)
    viewers = HttpViewers(Load(), time.monotonic)
    app = frames_app(HttpFrames(source, viewers, rate))
    sessions = {"/render": render_session(source)}
    async with Http3Server(
        app, host="127.0.0.1", certificate=certificate, webtransport=sessions, limits=LIMITS
    ) as server:
        memory = asyncio.create_task(keep_releasing_memory())  # as the service does
        await asyncio.sleep(0)
        announce(server.port)
        await memory


async def run_stock(certificate: Certificate, size: int) -> None:
    header = FrameHeader(status=200, seq=0, content_type="image/jpeg", width=1280, height=720, timing=TIMING)
    text = header.model_dump_json().encode()
    body = bytes(size)
    answer = struct.pack("!I", len(text)) + text + body

    class Stock(QuicConnectionProtocol):
        http: H3Connection | None = None
        sessions: set[int]

        def quic_event_received(self, event: QuicEvent) -> None:
            if isinstance(event, ProtocolNegotiated):
                self.http = H3Connection(self._quic, enable_webtransport=True)
                self.sessions = set()
            for h3_event in self.http.handle_event(event) if self.http is not None else ():
                self.answer(self.http, h3_event)
            self.transmit()

        def answer(self, http: H3Connection | None, event: Any) -> None:
            assert http is not None
            match event:
                case HeadersReceived() if dict(event.headers)[b":method"] == b"CONNECT":
                    headers = [(b":status", b"200"), (b"sec-webtransport-http3-draft", b"draft02")]
                    http.send_headers(event.stream_id, headers)
                    self.sessions.add(event.stream_id)
                case DataReceived() if event.stream_ended and event.stream_id not in self.sessions:
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
    announce(server._transport.get_extra_info("sockname")[1])
    await asyncio.Event().wait()


def announce(port: int) -> None:
    """Report the server's port to the parent process."""
    print(port, flush=True)


def main(name: str, size: int) -> None:
    certificate = Certificate.create([], datetime.now(UTC))
    if name == "stock":
        asyncio.run(run_stock(certificate, size))
    else:
        uvloop.run(run_ours(certificate, size))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
