"""The service looks after itself for as long as it runs."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tests.render.fakes import FakeRasterizer
from tests.render.scenes import plys
from tigas_common.certificate import Certificate
from tigas_common.settings import load_settings
from tigas_render import service as service_module
from tigas_render.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio


async def test_a_certificate_is_renewed_although_housekeeping_failed_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Here scenes can never be unloaded, and the disk is full when the certificate is first handed out."""
    monkeypatch.setattr(service_module, "HOUSEKEEPING_S", 0.001)
    handed_out: list[Certificate] = []
    renewed = asyncio.Event()

    def evict_idle(now: float) -> None:
        raise RuntimeError("no scene can be unloaded")

    def use(certificate: Certificate) -> None:
        handed_out.append(certificate)
        if len(handed_out) == 2:
            raise OSError("No space left on device")
        if len(handed_out) == 3:
            renewed.set()

    async with RenderService.open(RenderSettings(cache=tmp_path), FakeRasterizer()) as service:
        monkeypatch.setattr(service.registry, "evict_idle", evict_idle)
        service.on_renewal(use)
        service.certificate = Certificate.create([], datetime.now(UTC) - timedelta(days=12))
        async with asyncio.timeout(20):
            await renewed.wait()
        first, failed, last = handed_out
        assert first != failed
        assert failed is last is service.certificate
        assert not service.certificate.needs_renewal(datetime.now(UTC))
    assert "no scene can be unloaded" in caplog.text
    assert "No space left on device" in caplog.text


OWN = '[{"name": "Small", "width": 320, "height": 180, "quality": 50, "expected_kb": 9}]'


@pytest.mark.parametrize(
    ("setting", "of_the_server", "of_the_scene"),
    [("scene", "High", "Small"), ("paper", "High", None), (OWN.replace("Small", "Ours"), "Ours", None)],
)
async def test_scenes_have_ladders_of_their_own_unless_the_settings_name_one_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: str, of_the_server: str, of_the_scene: str | None
) -> None:
    monkeypatch.setenv("TIGAS_RENDER_LADDER", setting)
    plys.write(tmp_path / "hall" / "scene.ply", plys.binary_ply())
    plys.write(tmp_path / "hall" / "ladder.json", f'{{"rungs": {OWN}}}'.encode())
    settings = load_settings(RenderSettings, {"scenes": tmp_path, "cache": tmp_path / "cache"})
    async with RenderService.open(settings, FakeRasterizer()) as service:
        ladder = (await service.info("hall")).ladder
        assert service.config("localhost").ladder[0].name == of_the_server
        assert (ladder and ladder[0].name) == of_the_scene
