"""Each service's application over stand-ins: a fake rasteriser, render service and link, in an empty directory."""

from __future__ import annotations

import string
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
from starlette.types import ASGIApp

from tests.cluster.hosts import FakeFleet, load
from tests.dash.fakes import FakeRender
from tests.experiments.made_up import MACHINE
from tests.experiments.store.conftest import NOBODY, in_a_thread, services
from tests.render.fakes import FakeRasterizer
from tests.render.scenes import plys
from tests.shaper.conftest import FakeGateway, FakeLink, FakeTime, make_player, trace
from tigas_cluster.director import create_director
from tigas_cluster.fleet import HostAddress, HostState
from tigas_common.address import Address
from tigas_common.origins import OriginPolicy
from tigas_common.render_requests import RenderClient
from tigas_common.topology import PAGE_ORIGINS
from tigas_dash.app import create_app as dash_app
from tigas_dash.clock import Clock
from tigas_dash.sessions import Sessions
from tigas_dash.webrtc.stream import WebRtcServer
from tigas_experiments.store.app import create_app as store_app
from tigas_experiments.store.main import open_store
from tigas_render.server.app import create_app as render_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_shaper.api import create_app as shaper_app
from tigas_shaper.service import Shaper
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.library import TraceLibrary

Service = Callable[[Path], AbstractAsyncContextManager[ASGIApp]]
LONG_S = 600


@asynccontextmanager
async def render(folder: Path) -> AsyncIterator[ASGIApp]:
    """With one scene, which takes no time."""
    models = folder / "models"
    plys.write(models / "scene" / "scene.ply", plys.binary_ply())
    rasterizer = FakeRasterizer()
    rasterizer.gate.set()
    async with RenderService.open(RenderSettings(scenes=models, cache=folder / "cache"), rasterizer) as service:
        yield render_app(service)


@asynccontextmanager
async def dash(folder: Path) -> AsyncIterator[ASGIApp]:
    """Before a fake render service."""
    transport = httpx.ASGITransport(FakeRender().app, raise_app_exceptions=False)
    async with (
        httpx.AsyncClient(transport=transport, base_url="http://render") as upstream,
        Sessions(RenderClient(upstream), "libx264", Clock(), limit=2, idle_s=LONG_S).run() as sessions,
        WebRtcServer.listen(RenderClient(upstream), Address("127.0.0.1", 0), Clock()) as webrtc,
    ):
        yield dash_app(sessions, OriginPolicy(), webrtc)


@asynccontextmanager
async def shaper(folder: Path) -> AsyncIterator[ASGIApp]:
    """Over a link that is made up, with one trace."""
    (folder / "steps.csv").write_text(format_csv(trace(4_000, 0, 8_000, name="steps")))
    link = FakeLink(time := FakeTime())
    player = make_player(time, link)
    running = Shaper(link, FakeGateway(), player, TraceLibrary(folder))  # type: ignore[arg-type]
    try:
        yield shaper_app(running, OriginPolicy(pages=PAGE_ORIGINS, programs=False))
    finally:
        player.close()


@asynccontextmanager
async def store(folder: Path) -> AsyncIterator[ASGIApp]:
    """Over an empty directory."""
    made = open_store(folder, folder, NOBODY, machine=MACHINE, load=(), offload=in_a_thread, services=services)
    async with made as opened:
        yield store_app(opened, OriginPolicy())


@asynccontextmanager
async def director(folder: Path) -> AsyncIterator[ASGIApp]:
    """Before one host."""
    fleet = FakeFleet(HostState(HostAddress("here", "http://127.0.0.1:8080"), load()))
    async with (
        render(folder) as host,
        create_director(fleet, origins=OriginPolicy(), clock=time.monotonic, transport=_Host(host)) as app,
    ):
        yield app


class _Host(httpx.ASGITransport):
    """Hands on the target that the proxy names, as a real transport does."""

    async def handle_async_request(self, request: httpx.Request) -> httpx.Response:
        target = quote(request.extensions.get("target", request.url.raw_path), safe=string.punctuation.replace("#", ""))
        request.url = request.url.copy_with(raw_path=target.encode())
        return await super().handle_async_request(request)


SERVICES: dict[str, Service] = {"render": render, "dash": dash, "shaper": shaper, "store": store, "director": director}


@asynccontextmanager
async def client_of(service: str, folder: Path, **options: Any) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a service, which gets 500 for what the application raises."""
    async with SERVICES[service](folder) as app:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost:8080", **options) as client:
            yield client
