"""A real browser follows new keys and notices a server that has forgotten it; tests/web has the page's transports."""

from __future__ import annotations

import functools
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from aioquic.tls import Epoch
from playwright.async_api import async_playwright

from tests.prerequisites import CHROMIUM
from tests.render.transport.client import CERTIFICATE, FakeFrames, request_body
from tests.render.transport.serving import hello
from tigas_experiments.run.browser import find_chromium
from tigas_render.transport import server as server_module
from tigas_render.transport.aioquic_ext import receiving
from tigas_render.transport.aioquic_ext.quic import ServerQuicConnection
from tigas_render.transport.frames import render_session

ARGUMENTS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run"]
OPEN = """
async ({ url, hash }) => {
  const value = Uint8Array.from(atob(hash), (c) => c.charCodeAt(0));
  globalThis.transport = new WebTransport(url, { serverCertificateHashes: [{ algorithm: "sha-256", value }] });
  await transport.ready;
  globalThis.ask = async (request) => {
    const { readable, writable } = await transport.createBidirectionalStream();
    const writer = writable.getWriter();
    await writer.write(new TextEncoder().encode(request));
    await writer.close();
    return (await new Response(readable).arrayBuffer()).byteLength;
  };
}
"""
ASK_AND_WAIT = """
async ({ request, patience }) => {
  ask(request).catch(() => undefined);
  const late = new Promise((resolve) => setTimeout(() => resolve("open"), patience));
  return Promise.race([late, transport.closed.then(() => "closed", () => "broken")]);
}
"""
PATIENCE_S = 4
"""Chromium alone abandons its data after twice that, and an idle connection after 30 s."""


@pytest.mark.anyio
@pytest.mark.slow
async def test_chromium_follows_new_keys_and_does_not_wait_for_a_server_that_has_forgotten_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    CHROMIUM.require()
    monkeypatch.setattr(receiving, "KEY_PACKETS", 20)
    keys = set()

    class Watched(ServerQuicConnection):
        def _update_keys_if_due(self, now: float) -> None:
            super()._update_keys_if_due(now)
            keys.add(self._cryptos[Epoch.ONE_RTT].recv.secret)

    monkeypatch.setattr(server_module, "ServerQuicConnection", Watched)
    # a browser trusts a page on http://localhost as if it came over TLS
    pages = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(SimpleHTTPRequestHandler, directory=str(tmp_path)))
    threading.Thread(target=pages.serve_forever, daemon=True).start()
    sessions = {"/render": render_session(FakeFrames(bytes(51_200)))}
    async with (
        server_module.Http3Server(hello, certificate=CERTIFICATE, webtransport=sessions) as server,
        async_playwright() as playwright,
    ):
        browser = await playwright.chromium.launch(executable_path=find_chromium(), args=ARGUMENTS)
        page = await browser.new_page()
        await page.goto(f"http://localhost:{pages.server_port}/")
        target = {"url": f"https://127.0.0.1:{server.port}/render", "hash": CERTIFICATE.sha256}
        await page.evaluate(OPEN, target)
        request = request_body().decode()
        for _ in range(5):
            assert await page.evaluate("(request) => ask(request)", request) > 51_200
        assert len(keys - {None}) > 3
        for connection in list(server._connections):  # as if it had been started again
            connection.abandon()
            server._connections.remove(connection)
        asked = {"request": request, "patience": PATIENCE_S * 1000}
        assert await page.evaluate(ASK_AND_WAIT, asked) == "broken"
        await browser.close()
    pages.shutdown()
    pages.server_close()
