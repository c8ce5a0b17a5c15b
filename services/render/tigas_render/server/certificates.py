"""The service's own certificate, renewed before it expires."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from typing import Self

from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate

logger = logging.getLogger(__name__)

CHECK_INTERVAL_S = 15
"""Seconds between checks of the certificate."""

OnCertificate = Callable[[Certificate], None]


class CertificateRenewer:
    """Creates certificates, and passes them to the servers."""

    def __init__(self, settings: RenderSettings) -> None:
        self._names = [socket.gethostname(), *(address.host for address in settings.addresses)]
        self.certificate = Certificate.create(self._names, datetime.now(UTC))
        self._listeners: list[OnCertificate] = []
        self._pending: list[OnCertificate] = []
        """Callbacks that have not received the newest certificate yet."""

    @classmethod
    @asynccontextmanager
    async def run(cls, settings: RenderSettings) -> AsyncIterator[Self]:
        """Renew the certificate in the background, as a context manager."""
        renewer = cls(settings)
        checking = asyncio.create_task(renewer._check_regularly())
        try:
            yield renewer
        finally:
            checking.cancel()

    def add_listener(self, listener: OnCertificate) -> None:
        """Call `listener` with the current certificate, and again with each replacement."""
        listener(self.certificate)
        self._listeners.append(listener)

    async def _check_regularly(self) -> None:
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            try:
                self._renew()
            except Exception:  # a full disk, for example; the next check tries again
                logger.exception("The certificate could not be renewed")

    def _renew(self) -> None:
        now = datetime.now(UTC)
        if self.certificate.needs_renewal(now):
            self.certificate = Certificate.create(self._names, now)
            self._pending = list(self._listeners)
        while self._pending:
            self._pending[0](self.certificate)
            del self._pending[0]
