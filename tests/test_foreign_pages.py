"""What other web pages can do with the services on a visitor's machine, and under a name that they made lead there."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest
from starlette.types import ASGIApp

from tests.dash.conftest import running_packager
from tests.experiments.store.conftest import running_store
from tests.render.fakes import FakeRasterizer
from tests.shaper.fakes import FakeGateway, FakeLink, FakeTime
from tigas_common.origins import OriginPolicy
from tigas_common.wire.shaper import LinkSetting
from tigas_render.app import create_app as create_render
from tigas_render.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_shaper.api import create_app as create_shaper
from tigas_shaper.player import Player
from tigas_shaper.service import Shaper
from tigas_shaper.traces.library import TraceLibrary

pytestmark = pytest.mark.anyio

PAGE = {"Origin": "http://localhost:8080"}
"""The viewer's own page."""
EVIL = {"Origin": "https://evil.example"}
NOBODY = {"Origin": "null"}
"""A page in a sandbox."""
IMAGE = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
"""What another page embeds has no Origin."""
FRAME = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"}
REBOUND = {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}
"""Another page whose name leads to this machine by now: DNS rebinding."""

REQUESTS = {
    "render": (
        "GET /config.json",
        "GET /scenes?scan=1",
        "GET /metrics",
        "POST /render",
        "POST /scenes/courtyard/load",
        "POST /scenes/courtyard/unload",
    ),
    "dash": ("GET /sessions", "POST /sessions", "GET /sessions/a/r0-500/1.m4s", "DELETE /sessions/a"),
    "shaper": ("GET /status", "GET /events", "GET /traces", "POST /stop", "POST /link", "POST /traces"),
    "store": (
        "GET /experiments",
        "GET /experiments/a/zip",
        "GET /movements",
        "POST /experiments",
        "DELETE /experiments/a",
    ),
}
CASES = [(service, request) for service, requests in REQUESTS.items() for request in requests]


@asynccontextmanager
async def render(directory: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with (
        RenderService.open(RenderSettings(cache=directory), FakeRasterizer()) as service,
        client(create_render(service)) as http,
    ):
        yield http


@asynccontextmanager
async def dash(directory: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with running_packager() as packager:
        yield packager.http


@asynccontextmanager
async def shaper(directory: Path) -> AsyncIterator[httpx.AsyncClient]:
    time = FakeTime()
    link = FakeLink(time)
    player = Player(link, LinkSetting(100_000, 50_000), clock=time.clock, sleep=time.sleep)
    running = Shaper(link, FakeGateway(), player, TraceLibrary(None))  # type: ignore[arg-type]
    async with client(create_shaper(running, OriginPolicy(programs=False))) as http:
        yield http
    player.close()


@asynccontextmanager
async def store(directory: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with running_store(directory, policy=OriginPolicy()) as running:
        yield running.http


def client(app: ASGIApp) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url="http://localhost:8080")


SERVICES = {"render": render, "dash": dash, "shaper": shaper, "store": store}


@pytest.mark.parametrize(("service", "request_line"), CASES)
async def test_a_foreign_page_reads_changes_and_opens_nothing(service: str, request_line: str, tmp_path: Path) -> None:
    method, path = request_line.split()
    attacks: list[tuple[Mapping[str, str], int]] = [(EVIL, 403), (NOBODY, 403), (REBOUND, 421)]
    if method == "GET":
        attacks += [(IMAGE, 403), (FRAME, 403), ({"Host": "evil.example"}, 421)]
    async with SERVICES[service](tmp_path) as http:
        for headers, status in attacks:
            answer = await http.request(method, path, headers=headers)
            assert answer.status_code == status, headers
            assert answer.json()["type"] == ("tigas:foreign-host" if status == 421 else "tigas:foreign-origin")
            assert "access-control-allow-origin" not in answer.headers
            preflight = dict(headers) | {"Access-Control-Request-Method": method}
            assert (await http.options(path, headers=preflight)).status_code in (403, 405, 421)


@pytest.mark.parametrize("service", SERVICES)
async def test_the_viewers_page_reads_and_every_answer_is_protected(service: str, tmp_path: Path) -> None:
    async with SERVICES[service](tmp_path) as http:
        for path, status in (("/healthz", 200), ("/nowhere", 404)):
            answer = await http.get(path, headers={"Origin": "http://localhost:9999"})
            assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (
                status,
                "http://localhost:9999",
            )
            assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
            assert answer.headers["cross-origin-resource-policy"] == "same-origin"
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert answer.headers["referrer-policy"] == "strict-origin"
        assert (await http.get("/healthz")).status_code == 200  # a program
