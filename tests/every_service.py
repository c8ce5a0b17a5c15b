"""Each service's application over stand-ins: no rasteriser, no render service, no link, an empty directory."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import httpx
from starlette.applications import Starlette
from starlette.types import ASGIApp

from tests.cluster.hosts import FakeFleet, load
from tests.experiments.made_up import MACHINE
from tests.experiments.store.conftest import NOBODY, in_a_thread, services
from tests.render.fakes import FakeRasterizer
from tests.shaper.fakes import FakeGateway, FakeLink, FakeTime
from tigas_cluster.director import create_director
from tigas_cluster.fleet import HostAddress, HostState
from tigas_common.address import Address
from tigas_common.origins import OriginPolicy
from tigas_common.topology import PAGE_ORIGINS
from tigas_common.wire.shaper import LinkSetting
from tigas_dash.app import create_app as dash_app
from tigas_dash.clock import Clock
from tigas_dash.sessions import Sessions
from tigas_dash.source import RenderClient
from tigas_dash.webrtc.service import WebRtc
from tigas_experiments.store.app import Store
from tigas_experiments.store.app import create_app as store_app
from tigas_experiments.store.experiments import Experiments
from tigas_experiments.store.movements import Movements
from tigas_experiments.store.planner import Planner
from tigas_experiments.store.reports import Reports
from tigas_experiments.store.rerendering import Rerendering
from tigas_experiments.store.workspace import Workspace
from tigas_render.server.app import create_app as render_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_shaper.api import create_app as shaper_app
from tigas_shaper.player import Player
from tigas_shaper.service import Shaper
from tigas_shaper.traces.library import TraceLibrary

Service = Callable[[Path], AbstractAsyncContextManager[ASGIApp]]
LONG_S = 600


@asynccontextmanager
async def render(folder: Path) -> AsyncIterator[ASGIApp]:
    """Without a rasteriser."""
    async with RenderService.open(RenderSettings(cache=folder / "cache"), FakeRasterizer()) as service:
        yield render_app(service)


@asynccontextmanager
async def dash(folder: Path) -> AsyncIterator[ASGIApp]:
    """Before a render service that is not there."""
    async with (
        httpx.AsyncClient(base_url="http://127.0.0.1:9", trust_env=False) as nobody,
        Sessions(RenderClient(nobody), "libx264", Clock(), limit=1, idle_s=LONG_S).running() as sessions,
        WebRtc.running(RenderClient(nobody), Address("127.0.0.1", 0), Clock()) as webrtc,
    ):
        yield dash_app(sessions, OriginPolicy(), webrtc)


@asynccontextmanager
async def shaper(folder: Path) -> AsyncIterator[ASGIApp]:
    """Over a link that is made up, with the traces of a directory."""
    link = FakeLink(time := FakeTime())
    player = Player(link, LinkSetting(100_000, 50_000), clock=time.clock, sleep=time.sleep)
    running = Shaper(link, FakeGateway(), player, TraceLibrary(folder))  # type: ignore[arg-type]
    try:
        yield shaper_app(running, OriginPolicy(pages=PAGE_ORIGINS, programs=False))
    finally:
        player.close()


@asynccontextmanager
async def store(folder: Path) -> AsyncIterator[ASGIApp]:
    """Over an empty directory."""
    with Workspace.opened(folder) as workspace:
        experiments = Experiments(folder, workspace)
        reports, kept = Reports(experiments, workspace, in_a_thread), Movements(folder)
        materialisations = Rerendering(experiments, NOBODY)
        planner = Planner(
            experiments,
            workspace,
            in_a_thread,
            movements=folder,
            render=NOBODY,
            services=services,
            machine=MACHINE,
            load=(),
        )
        made = Store(workspace, experiments, reports, kept, planner, materialisations)
        yield store_app(made, OriginPolicy())


@asynccontextmanager
async def director(folder: Path) -> AsyncIterator[ASGIApp]:
    """Before a host that has nothing."""
    fleet = FakeFleet(HostState(HostAddress("nobody", "http://127.0.0.1:9"), load()))
    nothing = httpx.ASGITransport(Starlette())
    async with create_director(fleet, origins=OriginPolicy(), clock=time.monotonic, transport=nothing) as app:
        yield app


SERVICES: dict[str, Service] = {"render": render, "dash": dash, "shaper": shaper, "store": store, "director": director}
