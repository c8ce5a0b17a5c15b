"""The running service: background work, load, and ladders."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import httpx
import pytest

from tests.eventually import eventually
from tests.render.fakes import FakeRasterizer, render_request
from tests.render.scenes import plys
from tigas_common.command import load
from tigas_common.errors import Overloaded
from tigas_common.parsing import parse
from tigas_common.wire.render import HostLoad
from tigas_render.admission import viewers
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneSource
from tigas_render.server import service as service_module
from tigas_render.server.app import create_app
from tigas_render.server.main import wait_until_stopped_or_lost
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio


async def test_housekeeping_goes_on_although_it_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(service_module, "HOUSEKEEPING_S", 0.001)
    kept = asyncio.Event()

    def evict_idle(now: float) -> None:
        if "no scene can be unloaded" in caplog.text:
            kept.set()
        raise RuntimeError("no scene can be unloaded")

    async with RenderService.open(RenderSettings(cache=tmp_path), FakeRasterizer()) as service:
        monkeypatch.setattr(service.registry, "evict_idle", evict_idle)
        async with asyncio.timeout(20):
            await kept.wait()


async def test_a_stopping_service_ends_loading_and_downloads_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def endless(_: SceneSource, listener: Listener) -> NoReturn:
        while True:
            listener(0.5)

    monkeypatch.setattr(SceneSource, "read", endless)
    stop = asyncio.Event()

    async def stopped() -> None:
        await stop.wait()

    async with RenderService.open(RenderSettings(cache=tmp_path), FakeRasterizer()) as service:
        loading = asyncio.create_task(service.load("courtyard"))
        making = asyncio.create_task(service.downloads.get(service.registry.source("courtyard")))
        await asyncio.sleep(0)
        assert service.registry.scene_info("courtyard").state == "loading"
        stop.set()
        await wait_until_stopped_or_lost(stopped(), service)
        for work in (loading, making):
            with pytest.raises(Overloaded, match="the service is stopping"):
                await work


@pytest.fixture
async def service(tmp_path: Path) -> AsyncIterator[RenderService]:
    async with RenderService.open(RenderSettings(cache=tmp_path), FakeRasterizer()) as service:
        yield service


@pytest.fixture
async def client(service: RenderService) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(create_app(service))
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost:8080") as client:
        yield client


async def test_a_viewer_that_has_left_counts_no_more(
    service: RenderService, client: httpx.AsyncClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with service.monitor_load():
        nowhere = render_request(scene="nowhere").model_dump_json(exclude_none=True)
        assert (await client.post("/render", content=nowhere)).status_code == 404
        await eventually(lambda: service.loads.viewers == 1)
        monkeypatch.setattr(viewers, "STAY_S", 0.0)
        await eventually(lambda: service.loads.viewers == 0)


async def test_a_director_hears_how_busy_the_host_is(service: RenderService, client: httpx.AsyncClient) -> None:
    idle = parse(HostLoad, (await client.get("/api/load")).content)
    assert (idle.viewers, idle.utilisation, idle.queue_age_s, idle.config.retry_after_s) == (0, 0, 0, None)
    assert idle.config.model_dump(mode="json") == (await client.get("/config.json")).json()
    ages = {"datagrams": 0.001, "loop": 0.002, "engine": 0.3}
    one = replace(service.admission.load.state, viewers=3, utilisation=0.5, engine_utilisation=0.7, ages=ages)
    service.loads.update(0, one)
    service.loads.update(1, replace(one, viewers=4, utilisation=1.0, ages={}, full=5.0))
    busy = parse(HostLoad, (await client.get("/api/load")).content)
    assert (busy.viewers, busy.utilisation, busy.queue_age_s, busy.config.retry_after_s) == (7, 0.75, 0.3, 5.0)
    assert 'tigas_render_full{edge="1"} 1.0' in (await client.get("/metrics")).text


OWN = '[{"name": "Small", "width": 320, "height": 180, "quality": 50, "expected_kb": 9}]'


@pytest.mark.parametrize(
    ("setting", "of_the_server", "of_the_scene"),
    [("scene", "High", "Small"), ("paper", "High", None)],
)
async def test_scenes_have_ladders_of_their_own_unless_the_settings_name_one_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: str, of_the_server: str, of_the_scene: str | None
) -> None:
    monkeypatch.setenv("TIGAS_RENDER_LADDER", setting)
    plys.write(tmp_path / "hall" / "scene.ply", plys.binary_ply())
    plys.write(tmp_path / "hall" / "ladder.json", f'{{"rungs": {OWN}}}'.encode())
    settings = load(RenderSettings, {"scenes": tmp_path, "cache": tmp_path / "cache"})
    async with RenderService.open(settings, FakeRasterizer()) as service:
        ladder = (await service.scene_info("hall")).ladder
        assert service.config("http://localhost:8080").ladder[0].name == of_the_server
        assert (ladder and ladder[0].name) == of_the_scene


async def test_previews_of_many_scenes_wait_for_each_other(tmp_path: Path) -> None:
    ids = [f"scene {number}" for number in range(9)]
    for id in ids:
        plys.write(tmp_path / "models" / f"{id}.ply", plys.binary_ply(10))
    rasterizer = FakeRasterizer()
    settings = RenderSettings(cache=tmp_path / "cache", scenes=tmp_path / "models")
    async with RenderService.open(settings, rasterizer) as service:
        await service.registry.scan()
        previews = [asyncio.create_task(service.preview(id)) for id in ids]

        def all_wait() -> bool:
            waiting, ended = sum(service.engine.in_flight.values()), sum(each.done() for each in previews)
            return waiting + ended == len(ids)

        await eventually(all_wait)
        rasterizer.gate.set()
        assert len(await asyncio.gather(*previews)) == len(ids)
