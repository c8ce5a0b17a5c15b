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
from tests.render.transport.client import CERTIFICATE, FakeFrames, request_body
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
  const transport = new WebTransport(url, {
    serverCertificateHashes: [{ algorithm: "sha-256", value: Uint8Array.from(atob(hash), (c) => c.charCodeAt(0)) }],
  });
  await transport.ready;
  const encode = (text) => new TextEncoder().encode(text);

  const open = async (request) => {
    const stream = await transport.createBidirectionalStream();
    const writer = stream.writable.getWriter();
    await writer.write(encode(request));
    await writer.close();
    return stream.readable.getReader();
  };
  const join = (parts) => {
    const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
    let at = 0;
    for (const part of parts) { all.set(part, at); at += part.length; }
    return all;
  };
  const parse = (bytes) => {
    const length = new DataView(bytes.buffer).getUint32(0);
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    const body = bytes.subarray(4 + length);
    return { status: header.status, seq: header.seq, size: body.length, sum: body.reduce((sum, b) => sum + b, 0) };
  };

  const overStream = async (request) => {
    const reader = await open(request);
    const parts = [];
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return parse(join(parts));
      parts.push(value);
    }
  };
  const streams = await Promise.all(requests.streams.map(overStream));

  const cancelled = await open(requests.cancelled);
  await cancelled.cancel();

  const writer = transport.datagrams.writable.getWriter();
  const reader = transport.datagrams.readable.getReader();
  await writer.write(encode(requests.datagram));
  const parts = new Map();
  let count = 1;
  while (parts.size < count) {
    const { value } = await reader.read();
    const view = new DataView(value.buffer, value.byteOffset);
    count = view.getUint16(6);
    parts.set(view.getUint16(4), value.subarray(8));
  }
  const datagrams = parse(join([...Array(count).keys()].map((number) => parts.get(number))));

  const after = await overStream(requests.after);
  transport.close();
  return { streams, datagrams, fragments: count, after };
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
async def browser_page(url: str) -> AsyncIterator[Any]:
    CHROMIUM.require()
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=find_chromium(), args=ARGUMENTS)
        page = await browser.new_page()
        await page.goto(url)
        yield page
        await browser.close()


async def no_app(*_: object) -> None:
    raise NotImplementedError


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
    async with Http3Server(no_app, certificate=CERTIFICATE, webtransport={"/render": render_session(source)}) as server:
        with secure_page() as url:
            async with browser_page(url) as page:
                result = await page.evaluate(
                    SCRIPT,
                    {
                        "url": f"https://{host}:{server.port}/render",
                        "hash": CERTIFICATE.sha256,
                        "requests": {
                            "streams": [request_body(seq=seq).decode() for seq in range(4)],
                            "cancelled": request_body(seq=9).decode(),
                            "datagram": request_body(seq=20).decode(),
                            "after": request_body(seq=21).decode(),
                        },
                    },
                )
                await source.until(lambda: 9 in source.cancelled)
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
    sessions = {"/render": render_session(FakeFrames())}
    async with Http3Server(no_app, certificate=CERTIFICATE, webtransport=sessions) as server:
        with secure_page() as url:
            async with browser_page(url) as page:
                target = {"url": f"https://127.0.0.1:{server.port}/render", "hash": CERTIFICATE.sha256}
                await page.evaluate(OPEN, target)
                for connection in list(server._connections):  # as if it had been started again
                    connection.abandon()
                    server._connections.remove(connection)
                asked = {"request": request_body(seq=1).decode(), "patience": PATIENCE_S * 1000}
                assert await page.evaluate(ASK_AND_WAIT, asked) == "broken"
