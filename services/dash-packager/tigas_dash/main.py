"""Wires the packager together: settings in, streams and API up, until told to stop."""

from __future__ import annotations

from contextlib import AsyncExitStack
from importlib.util import find_spec
from typing import TYPE_CHECKING

import av.logging
import httpx

from tigas_common.address import Address, say_if_open
from tigas_common.memory import keep_together
from tigas_common.origins import OriginPolicy
from tigas_common.runner import explained, serve_http, until_stopped
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.encoder import choose_encoder
from tigas_dash.sessions import Sessions
from tigas_dash.settings import DashSettings
from tigas_dash.source import RenderClient

if TYPE_CHECKING:
    from tigas_dash.webrtc.service import WebRtc


async def serve(settings: DashSettings) -> None:
    """Run the packager until SIGINT or SIGTERM. Raises StartError."""
    keep_together()
    av.logging.set_level(av.logging.PANIC)  # what the encoder refuses is told to whoever asked
    encoder = choose_encoder() if settings.encoder == "auto" else settings.encoder
    async with AsyncExitStack() as stack:
        # Newest views only: a connection is made for each that is in flight, and none is waited for.
        http = await stack.enter_async_context(
            httpx.AsyncClient(base_url=settings.render, limits=httpx.Limits(max_connections=None), trust_env=False)
        )
        client, clock = RenderClient(http), Clock()
        sessions = await stack.enter_async_context(
            Sessions(client, encoder, clock, limit=settings.max_sessions, idle_s=settings.idle_s).running()
        )
        with explained(settings.http, "--http"):
            policy = OriginPolicy.of([settings.http], settings.allow_hosts, settings.allow_origins)
            webrtc = await with_webrtc(stack, client, settings.http, clock)
            app = create_app(sessions, policy, webrtc)
            serving = serve_http(app, settings.http, settings.http_limits, websockets=True)
            port = await stack.enter_async_context(serving)
        say_if_open([settings.http])
        more = "" if webrtc is None else f", and WebRTC on UDP port {webrtc.port_number}"
        print(f"DASH streams by {encoder} on http://{settings.http.reachable_host}:{port}/{more}", flush=True)
        await until_stopped()


async def with_webrtc(stack: AsyncExitStack, client: RenderClient, address: Address, clock: Clock) -> WebRtc | None:
    """On the UDP port of the same number; None where it is not installed."""
    if find_spec("aiortc") is None:
        return None
    from tigas_dash.webrtc.service import WebRtc

    return await stack.enter_async_context(WebRtc.running(client, address, clock))
