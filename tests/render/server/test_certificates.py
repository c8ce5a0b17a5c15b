from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta

import pytest

from tigas_render.server import certificates
from tigas_render.server.certificates import CertificateRenewer
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate

pytestmark = pytest.mark.anyio


async def test_a_failed_renewal_is_repeated(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Here the disk is full when the new one is first handed out."""
    monkeypatch.setattr(certificates, "CHECK_INTERVAL_S", 0.001)
    handed_out: list[Certificate] = []
    renewed = asyncio.Event()

    def use(certificate: Certificate) -> None:
        handed_out.append(certificate)
        if len(handed_out) == 2:
            raise OSError("No space left on device")
        if len(handed_out) == 3:
            renewed.set()

    async with CertificateRenewer.run(RenderSettings()) as keeper:
        keeper.add_listener(use)
        keeper.certificate = Certificate.create([], datetime.now(UTC) - timedelta(days=12))
        async with asyncio.timeout(20):
            await renewed.wait()
        first, failed, last = handed_out
        assert first != failed
        assert failed is last is keeper.certificate
        assert not keeper.certificate.needs_renewal(datetime.now(UTC))
    assert "No space left on device" in caplog.text
