"""A real browser: Chromium opens a session by the certificate's hash and gets frames over streams and datagrams."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import AsyncIterator, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from aioquic.tls import Epoch
from playwright.async_api import async_playwright

from tests.prerequisites import CHROMIUM
from tests.render.transport.client import CERTIFICATE, FakeFrames, eventually, request_body
from tests.render.transport.serving import hello
from tigas_experiments.run.browser import find_chromium
from tigas_render.transport import server as server_module
from tigas_render.transport.aioquic_ext import receiving
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server

ARGUMENTS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run"]

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

SCRIPT = """
async ({ url, hash, requests }) => {
  const value = Uint8Array.from(atob(hash), (c) => c.charCodeAt(0));
  const transport = new WebTransport(url, { serverCertificateHashes: [{ algorithm: "sha-256", value }] });
  await transport.ready;
  const encode = (text) => new TextEncoder().encode(text);
  const parse = async (parts) => {
    const bytes = new Uint8Array(await new Blob(parts).arrayBuffer());
    const length = new DataView(bytes.buffer).getUint32(0);
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    const body = bytes.subarray(4 + length);
    return { status: header.status, seq: header.seq, size: body.length, sum: body.reduce((sum, b) => sum + b, 0) };
  };
  const open = async (request) => {
    const stream = await transport.createBidirectionalStream();
    const writer = stream.writable.getWriter();
    await writer.write(encode(request));
    await writer.close();
    return stream.readable;
  };
  const overStream = async (request) => parse([await new Response(await open(request)).arrayBuffer()]);

  const streams = await Promise.all(requests.streams.map(overStream));
  await (await open(requests.cancelled)).cancel();
  const reader = transport.datagrams.readable.getReader();
  await transport.datagrams.writable.getWriter().write(encode(requests.datagram));
  const parts = [];
  for (let count = 1, received = 0; received < count; received++) {
    const { value } = await reader.read();
    const view = new DataView(value.buffer, value.byteOffset);
    count = view.getUint16(6);
    parts[view.getUint16(4)] = value.slice(8);
  }
  const datagrams = await parse(parts);
  const after = await overStream(requests.after);
  transport.close();
  return { streams, datagrams, fragments: parts.length, after };
}
"""


@contextlib.contextmanager
def secure_page() -> Iterator[str]:
    """An empty page on http://localhost, which a browser trusts as if it came over TLS."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://localhost:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


@contextlib.asynccontextmanager
async def visited(source: FakeFrames, host: str) -> AsyncIterator[tuple[Http3Server, Any, dict[str, Any]]]:
    """A server, a page in Chromium, and the server's address and hash."""
    CHROMIUM.require()
    sessions = {"/render": render_session(source)}
    async with (
        server_module.Http3Server(hello, certificate=CERTIFICATE, webtransport=sessions) as server,
        async_playwright() as playwright,
    ):
        browser = await playwright.chromium.launch(executable_path=find_chromium(), args=ARGUMENTS)
        page = await browser.new_page()
        with secure_page() as url:
            await page.goto(url)
            yield server, page, {"url": f"https://{host}:{server.port}/render", "hash": CERTIFICATE.sha256}
        await browser.close()


@pytest.mark.parametrize(("host", "key_packets"), [("localhost", receiving.KEY_PACKETS), ("127.0.0.1", 20)])
async def test_chromium_gets_frames(monkeypatch: pytest.MonkeyPatch, host: str, key_packets: int) -> None:
    """Includes keys for a few packets only."""
    monkeypatch.setattr(receiving, "KEY_PACKETS", key_packets)
    keys = set()

    class Watched(ServerQuicConnection):
        def _renew_keys(self, now: float) -> None:
            super()._renew_keys(now)
            keys.add(self._cryptos[Epoch.ONE_RTT].recv.secret)

    monkeypatch.setattr(server_module, "ServerQuicConnection", Watched)
    source = FakeFrames(bytes(range(256)) * 200)
    source.held = {9}
    numbers = {"cancelled": 9, "datagram": 20, "after": 21}
    requests: dict[str, Any] = {name: request_body(seq=seq).decode() for name, seq in numbers.items()}
    requests["streams"] = [request_body(seq=seq).decode() for seq in range(4)]
    async with visited(source, host) as (_, page, target):
        result = await page.evaluate(SCRIPT, target | {"requests": requests})
        await eventually(lambda: 9 in source.cancelled)
    frame = {"status": 200, "size": 51_200, "sum": sum(source.body)}
    assert result["streams"] == [{**frame, "seq": seq} for seq in range(4)]
    assert result["datagrams"] == {**frame, "seq": 20}
    assert result["fragments"] > 30
    assert result["after"] == {**frame, "seq": 21}
    assert len({client for client, _ in source.requests}) == 1
    assert (len(keys - {None}) > 3) == (key_packets == 20)


OPEN = """
async ({ url, hash }) => {
  const algorithm = "sha-256";
  const value = Uint8Array.from(atob(hash), (c) => c.charCodeAt(0));
  globalThis.transport = new WebTransport(url, { serverCertificateHashes: [{ algorithm, value }] });
  await transport.ready;
}
"""
ASK_AND_WAIT = """
async ({ request, patience }) => {
  const ask = async () => {
    const writer = (await transport.createBidirectionalStream()).writable.getWriter();
    await writer.write(new TextEncoder().encode(request));
  };
  ask().catch(() => undefined);
  const late = new Promise((resolve) => setTimeout(() => resolve("open"), patience));
  return Promise.race([late, transport.closed.then(() => "closed", () => "broken")]);
}
"""
PATIENCE_S = 4
"""Chromium alone abandons its data after twice that, and an idle connection after 30 s."""


async def test_chromium_does_not_wait_for_a_server_that_has_forgotten_it() -> None:
    async with visited(FakeFrames(), "127.0.0.1") as (server, page, target):
        await page.evaluate(OPEN, target)
        for connection in list(server._connections):  # as if it had been started again
            connection.abandon()
            server._connections.remove(connection)
        asked = {"request": request_body(seq=1).decode(), "patience": PATIENCE_S * 1000}
        assert await page.evaluate(ASK_AND_WAIT, asked) == "broken"
