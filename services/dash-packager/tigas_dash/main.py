"""Wires the packager together: settings, streams and API."""

from __future__ import annotations

from contextlib import AsyncExitStack

import av.logging
import httpx

from tigas_common.address import warn_if_open
from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.origins import OriginPolicy
from tigas_common.render_requests import RenderClient
from tigas_common.resources import use_one_arena
from tigas_common.runner import listen_errors, serve_listener, wait_for_stop
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.encoder import choose_encoder
from tigas_dash.sessions import Sessions
from tigas_dash.settings import DashSettings
from tigas_dash.webrtc.stream import WebRtcServer


async def serve(settings: DashSettings) -> None:
    """Run the packager until SIGINT or SIGTERM. Raises StartError."""
    use_one_arena()
    av.logging.set_level(av.logging.PANIC)  # the encoder's errors are reported to clients
    limits = HttpLimits.from_settings(settings.http_limits)
    async with AsyncExitStack() as stack:
        with listen_errors(settings.http, "--http"):  # before anything slow
            listener = stack.enter_context(settings.http.listen(limits.unread_s))
        # Views in flight need a connection each, and none should wait for one.
        http = await stack.enter_async_context(
            httpx.AsyncClient(base_url=settings.render, limits=httpx.Limits(max_connections=None), trust_env=False)
        )
        client, clock = RenderClient(http), Clock()
        with listen_errors(settings.http, "--http"):
            webrtc = await stack.enter_async_context(WebRtcServer.listen(client, settings.http, clock))
        encoder = choose_encoder(settings.encoder)
        sessions = await stack.enter_async_context(
            Sessions(client, encoder, clock, limit=settings.max_sessions, idle_s=settings.idle_s).run()
        )
        policy = OriginPolicy.from_addresses([settings.http], settings.allow_hosts, settings.allow_origins)
        app = create_app(sessions, policy, webrtc)
        app = LoopShare(app, limits.loop_share_per_address, policy)
        port = await stack.enter_async_context(serve_listener(app, listener, limits, websockets=True))
        warn_if_open([settings.http])
        url = f"http://{settings.http.reachable_host}:{port}/"
        print(f"DASH streams by {encoder} on {url}, and WebRTC on UDP port {webrtc.port_number}", flush=True)
        await wait_for_stop()
