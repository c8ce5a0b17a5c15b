"""Background work of the running service."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import NoReturn

import pytest

from tests.render.fakes import FakeRasterizer
from tests.render.scenes import plys
from tigas_common.command import load
from tigas_common.errors import Overloaded
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneSource
from tigas_render.server import service as service_module
from tigas_render.server.main import until_stopped_or_lost
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


async def test_told_to_stop_it_ends_loading_before_it_answers_the_last_requests(
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
        await asyncio.sleep(0)
        assert service.registry.info("courtyard").state == "loading"
        stop.set()
        await until_stopped_or_lost(stopped(), service)
        with pytest.raises(Overloaded, match="the service is stopping"):
            await loading


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
        ladder = (await service.info("hall")).ladder
        assert service.config("http://localhost:8080").ladder[0].name == of_the_server
        assert (ladder and ladder[0].name) == of_the_scene
