"""200 KB frames to headless Chromium over WebTransport: our server against a stock aioquic server, in the same run.

    python -m benchmarks.transport [--seconds 3] [--rounds 3] [--in-flight 1 4] [--servers ours stock]

Both servers answer from memory, each in its own process, and take turns round by round. "Stock" is what aioquic's own
examples do: a default QuicConfiguration (1200-byte datagrams) on asyncio's loop, `serve`, one `sendto` a packet.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import functools
import http.server
import json
import statistics
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.asyncio.server import serve
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import HeadersReceived, WebTransportStreamDataReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import ProtocolNegotiated, QuicEvent

from tigas_common.certificate import Certificate
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import FrameHeader, RenderRequest, ServerTiming
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server

FRAME_BYTES = 200_000
TIMING = ServerTiming(queue=0, render=0, encode=0)
LENS = Intrinsics(900, 900, 640, 360, 1280, 720)
VIEW = RenderRequest.at("demo", Pose.from_euler(10, 0, 0, (0, 0, 0)), LENS, profile=0)
REQUEST = VIEW.model_dump(mode="json", exclude_none=True)
CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--no-first-run",
]
PAGE_SCRIPT = """
async ({ port, hash, request, inFlight, milliseconds }) => {
  const bytes = Uint8Array.from(atob(hash), (c) => c.charCodeAt(0));
  const transport = new WebTransport(`https://127.0.0.1:${port}/render`, {
    serverCertificateHashes: [{ algorithm: "sha-256", value: bytes }],
  });
  await transport.ready;
  const encoder = new TextEncoder();
  let seq = 0;
  const frame = async () => {
    const start = performance.now();
    const stream = await transport.createBidirectionalStream();
    const writer = stream.writable.getWriter();
    writer.write(encoder.encode(JSON.stringify({ ...request, seq: seq++ })));
    writer.close();
    let size = 0;
    const reader = stream.readable.getReader();
    for (;;) {
      const { value, done } = await reader.read();
      if (done) break;
      size += value.byteLength;
    }
    if (size < 200000) throw new Error(`a frame of ${size} bytes`);
    return performance.now() - start;
  };
  for (let i = 0; i < 30; i++) await frame();  // warm-up: congestion window, caches
  const times = [];
  const start = performance.now();
  const worker = async () => {
    while (performance.now() - start < milliseconds) times.push(await frame());
  };
  await Promise.all(Array.from({ length: inFlight }, worker));
  const seconds = (performance.now() - start) / 1000;
  transport.close();
  return { times, seconds };
}
"""


class Memory(FrameSource):
    """A FrameSource that has every frame already."""

    body = bytes(FRAME_BYTES)

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        frame = Frame(self.body, "jpeg", 1280, 720, request.seq, request.profile, TIMING)
        return asyncio.get_running_loop().call_soon(answered, frame).cancel


class StockProtocol(QuicConnectionProtocol):
    """aioquic's example server, reduced to a WebTransport session that answers each stream with a frame."""

    http: H3Connection | None = None

    def quic_event_received(self, event: QuicEvent) -> None:
        if isinstance(event, ProtocolNegotiated):
            self.http = H3Connection(self._quic, enable_webtransport=True)
        if self.http is None:
            return
        for h3_event in self.http.handle_event(event):
            if isinstance(h3_event, HeadersReceived):
                headers = [(b":status", b"200"), (b"sec-webtransport-http3-draft", b"draft02")]
                self.http.send_headers(h3_event.stream_id, headers)
            elif isinstance(h3_event, WebTransportStreamDataReceived) and h3_event.stream_ended:
                self._quic.send_stream_data(h3_event.stream_id, stock_answer(), end_stream=True)
        self.transmit()


@functools.cache
def stock_answer() -> bytes:
    header = FrameHeader(status=200, seq=0, content_type="image/jpeg", width=1280, height=720, timing=TIMING)
    text = header.model_dump_json().encode()
    return struct.pack("!I", len(text)) + text + Memory.body


async def run_stock(certificate: Certificate) -> None:
    configuration = QuicConfiguration(
        is_client=False,
        alpn_protocols=H3_ALPN,
        max_datagram_frame_size=65536,
        certificate=certificate.x509,
        private_key=certificate.private_key,
    )
    server = await serve("127.0.0.1", 0, configuration=configuration, create_protocol=StockProtocol)
    assert server._transport is not None
    announce(server._transport.get_extra_info("sockname")[1], certificate)
    await asyncio.Event().wait()


async def run_ours(certificate: Certificate) -> None:
    async def app(*_: Any) -> None:
        raise NotImplementedError

    sessions = {"/render": render_session(Memory())}
    async with Http3Server(app, host="127.0.0.1", certificate=certificate, webtransport=sessions) as server:
        announce(server.port, certificate)
        await asyncio.Event().wait()


def announce(port: int, certificate: Certificate) -> None:
    print(json.dumps({"port": port, "hash": certificate.sha256}), flush=True)


def run_server(name: str) -> None:
    certificate = Certificate.create([], datetime.now(UTC))
    if name == "stock":
        asyncio.run(run_stock(certificate))
    else:
        import uvloop

        uvloop.run(run_ours(certificate))


@contextlib.contextmanager
def server_process(name: str) -> Iterator[dict[str, Any]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.transport", "--serve", name], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        yield {**json.loads(process.stdout.readline()), "pid": process.pid}
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def blank_page() -> Iterator[str]:
    """A secure context: an empty page on http://localhost."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://localhost:{server.server_port}/"
        server.shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--serve", choices=["ours", "stock"], help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--in-flight", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--servers", nargs="+", choices=["ours", "stock"], default=["stock", "ours"])
    parser.add_argument("--chromium", help="the browser; one that is installed by default")
    arguments = parser.parse_args()
    if arguments.serve:
        run_server(arguments.serve)
        return

    from playwright.sync_api import sync_playwright

    from tigas_experiments.run.browser import find_chromium

    with contextlib.ExitStack() as stack:
        servers = {name: stack.enter_context(server_process(name)) for name in arguments.servers}
        url = stack.enter_context(blank_page())
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(
            executable_path=arguments.chromium or find_chromium(), args=CHROMIUM_ARGUMENTS
        )
        page = browser.new_page()
        page.goto(url)
        print(
            f"{FRAME_BYTES:,} bytes a frame, {arguments.rounds} rounds of {arguments.seconds:g} s, one stream a frame"
        )
        for in_flight in arguments.in_flight:
            rates: dict[str, list[float]] = {name: [] for name in servers}
            times: dict[str, list[float]] = {name: [] for name in servers}
            for _ in range(arguments.rounds):
                for name, server in servers.items():
                    options = {"request": REQUEST, "inFlight": in_flight, "milliseconds": arguments.seconds * 1000}
                    result = page.evaluate(PAGE_SCRIPT, {**options, "port": server["port"], "hash": server["hash"]})
                    rates[name].append(len(result["times"]) / result["seconds"])
                    times[name] += result["times"]
            for name in servers:
                p50, p95 = statistics.median(times[name]), statistics.quantiles(times[name], n=20)[18]
                rate = statistics.median(rates[name])
                print(f"{in_flight} in flight  {name:6} {rate:6.1f} frames/s   p50 {p50:5.1f} ms   p95 {p95:5.1f} ms")
            if len(servers) == 2:
                ratios = [ours / stock for ours, stock in zip(rates["ours"], rates["stock"], strict=True)]
                rounds = ", ".join(f"{ratio:.2f}" for ratio in ratios)
                print(f"{in_flight} in flight  ratio  {statistics.median(ratios):6.2f}x  (rounds: {rounds})")
        browser.close()


if __name__ == "__main__":
    main()
