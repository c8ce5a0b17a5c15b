"""Wires the packager together: settings in, streams and API up, until told to stop."""

from __future__ import annotations

from contextlib import AsyncExitStack

import av.logging
import httpx

from tigas_common.address import say_if_open
from tigas_common.memory import keep_together
from tigas_common.origins import OriginPolicy
from tigas_common.runner import explained, serve_http, until_stopped
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.encoder import choose_encoder
from tigas_dash.sessions import Sessions
from tigas_dash.settings import DashSettings
from tigas_dash.source import RenderClient


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
        sessions = await stack.enter_async_context(
            Sessions(
                RenderClient(http), encoder, Clock(), limit=settings.max_sessions, idle_s=settings.idle_s
            ).running()
        )
        with explained(settings.http, "--http"):
            policy = OriginPolicy.of([settings.http], settings.allow_hosts, settings.allow_origins)
            app = create_app(sessions, policy)
            serving = serve_http(app, settings.http, settings.http_limits, websockets=True)
            port = await stack.enter_async_context(serving)
        say_if_open([settings.http])
        print(f"DASH streams by {encoder} on http://{settings.http.reachable_host}:{port}/", flush=True)
        await until_stopped()
