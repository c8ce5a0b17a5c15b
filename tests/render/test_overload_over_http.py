"""Answers of an overloaded server to viewers without a session."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from tests.render.fakes import FakeRasterizer, render_request
from tests.render.transport.client import eventually
from tigas_common.parsing import parse
from tigas_common.wire.render import HostLoad
from tigas_render.admission import viewers
from tigas_render.admission.limits import Limits
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio

NOWHERE = render_request(scene="nowhere").model_dump(mode="json", exclude_none=True)
"""Answers 404 to processed requests."""


@pytest.fixture
async def service(tmp_path: Path) -> AsyncIterator[RenderService]:
    settings = RenderSettings(cache=tmp_path, quic_limits=Limits(requests_per_s=20))
    async with RenderService.open(settings, FakeRasterizer()) as service:
        yield service


def viewer(service: RenderService, address: str) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(create_app(service), client=(address, 1234))
    return httpx.AsyncClient(transport=transport, base_url="http://localhost:8080")


async def test_a_new_viewer_of_a_full_server_is_told_when_to_come_back(
    service: RenderService, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with viewer(service, "192.0.2.1") as known, viewer(service, "192.0.2.2") as new:
        assert (await known.post("/render", json=NOWHERE)).status_code == 404
        monkeypatch.setattr(service.admission.load, "full", lambda: 4.2)
        refused = await new.post("/render", json=NOWHERE)
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "5")
        assert refused.json()["type"] == "tigas:full"
        assert (await known.post("/render", json=NOWHERE)).status_code == 404
        assert (await new.get("/scenes")).status_code == 200


async def test_a_viewer_that_asks_no_more_counts_no_more_though_nobody_else_asks(
    service: RenderService, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with viewer(service, "192.0.2.1") as gone, service.measured():
        assert (await gone.post("/render", json=NOWHERE)).status_code == 404
        await eventually(lambda: service.loads.viewers == 1)
        monkeypatch.setattr(viewers, "STAY_S", 0.0)
        await eventually(lambda: service.loads.viewers == 0)


async def test_the_configuration_says_that_the_server_is_full(service: RenderService) -> None:
    async with viewer(service, "192.0.2.1") as client:
        async with service.measured(), asyncio.timeout(20):
            while not service.loads.states:  # noqa: ASYNC110 - it has no event to wait for
                await asyncio.sleep(0.02)
        assert (await client.get("/config.json")).json()["retry_after_s"] is None
        service.loads.heard(0, replace(service.admission.load.state, full=5.0))
        assert (await client.get("/config.json")).json()["retry_after_s"] == 5.0
        assert 'tigas_render_full{edge="0"} 1.0' in (await client.get("/metrics")).text


async def test_whoever_decides_where_viewers_go_hears_how_busy_the_host_is(service: RenderService) -> None:
    async with viewer(service, "192.0.2.1") as director:
        idle = parse(HostLoad, (await director.get("/api/load")).content)
        assert (idle.viewers, idle.utilisation, idle.queue_age_s, idle.config.retry_after_s) == (0, 0, 0, None)
        assert idle.config.model_dump(mode="json") == (await director.get("/config.json")).json()
        ages = {"datagrams": 0.001, "loop": 0.002, "engine": 0.3}
        one = replace(service.admission.load.state, viewers=3, utilisation=0.5, engine_utilisation=0.7, ages=ages)
        service.loads.heard(0, one)
        service.loads.heard(1, replace(one, viewers=4, utilisation=1.0, ages={}, full=5.0))
        busy = parse(HostLoad, (await director.get("/api/load")).content)
        assert (busy.viewers, busy.utilisation, busy.queue_age_s, busy.config.retry_after_s) == (7, 0.75, 0.3, 5.0)


async def test_who_asks_too_often_is_told_so(service: RenderService) -> None:
    async with viewer(service, "192.0.2.1") as eager:
        statuses = [(await eager.post("/render", json=NOWHERE)).status_code for _ in range(40)]
        assert set(statuses) == {404, 429}
