"""200 KB frames to headless Chromium over WebTransport: our server against a stock aioquic server, in the same run.

    python -m benchmarks.transport [--seconds 3] [--rounds 3] [--in-flight 1 4] [--servers ours stock]

Both servers (`benchmarks.servers`) answer from memory, each in its own process, and take turns round by round.
"""

from __future__ import annotations

import argparse
import contextlib
import http.server
import statistics
import threading
from collections.abc import Iterator
from typing import Any

from playwright.sync_api import sync_playwright

from benchmarks.hostile.client import request
from benchmarks.servers import NAMES, running
from tigas_experiments.run.browser import find_chromium

FRAME_BYTES = 200_000
REQUEST = request(1280, 720, profile=0)
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
    parser.add_argument("--seconds", type=float, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--in-flight", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--servers", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--chromium", help="the browser; one that is installed by default")
    arguments = parser.parse_args()
    with contextlib.ExitStack() as stack:
        servers = {name: stack.enter_context(running(name, FRAME_BYTES)) for name in arguments.servers}
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
                    result = page.evaluate(PAGE_SCRIPT, {**options, "port": server.port, "hash": server.hash})
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
