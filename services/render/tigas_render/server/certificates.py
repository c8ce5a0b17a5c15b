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

LOOK_S = 15
"""Seconds between checks of the certificate."""

Use = Callable[[Certificate], None]


class CertificateKeeper:
    """Creates certificates, and passes them to the servers."""

    def __init__(self, settings: RenderSettings) -> None:
        self._names = [socket.gethostname(), *(address.host for address in settings.addresses)]
        self.certificate = Certificate.create(self._names, datetime.now(UTC))
        self._uses: list[Use] = []
        self._to_renew: list[Use] = []
        """Callbacks that have not received the newest certificate yet."""

    @classmethod
    @asynccontextmanager
    async def running(cls, settings: RenderSettings) -> AsyncIterator[Self]:
        """A keeper that renews its certificate, as a context manager."""
        keeper = cls(settings)
        looking = asyncio.create_task(keeper._look())
        try:
            yield keeper
        finally:
            looking.cancel()

    def on_renewal(self, use: Use) -> None:
        """Call `use` with the current certificate, and again with each replacement."""
        use(self.certificate)
        self._uses.append(use)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                self._renew()
            except Exception:  # a full disk, for example; the next check tries again
                logger.exception("The certificate could not be renewed")

    def _renew(self) -> None:
        now = datetime.now(UTC)
        if self.certificate.needs_renewal(now):
            self.certificate = Certificate.create(self._names, now)
            self._to_renew = list(self._uses)
        while self._to_renew:
            self._to_renew[0](self.certificate)
            del self._to_renew[0]
