"""HTTP/3 connections to where scenes are served, as long as aioquic is installed and UDP gets there."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import httpx
from pydantic import ValidationError

from tigas_common.wire.render import ServerConfig

if TYPE_CHECKING:
    from tigas.http3 import Http3Connection

AGAIN_S = 30.0
"""After a failure HTTP/1.1 is used for so long."""


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a scene's frames come from."""

    authority: str
    connection: Http3Connection | None
    """None: not by HTTP/3, until"""
    again_at: float

    def is_over(self, now: float) -> bool:
        """Whether it is to be found anew."""
        return now >= self.again_at if self.connection is None else self.connection.is_closed


class Http3Hosts:
    """The connections of one client."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http
        self._places: dict[str, _Place] = {}
        self._connections: dict[tuple[str, str], Http3Connection] = {}
        self._connecting = asyncio.Lock()
        self._resources = AsyncExitStack()

    async def aclose(self) -> None:
        """Close them all."""
        await self._resources.aclose()

    async def post(self, scene: str, path: str, body: str, timeout_s: float) -> httpx.Response | None:
        """The answer of the host that serves a scene; None if it, or one with room, is to be asked over HTTP/1.1."""
        if find_spec("aioquic") is None:
            return None
        from tigas.http3 import Http3Failed

        async with self._connecting:
            place = await self._place(scene)
        if place.connection is None:
            return None
        try:
            async with asyncio.timeout(timeout_s):
                answer = await place.connection.post(place.authority, path, body.encode())
            if answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
                return answer
        except (Http3Failed, TimeoutError):
            pass
        self._places[scene] = _nowhere()
        return None

    async def _place(self, scene: str) -> _Place:
        known = self._places.get(scene)
        if known is None or known.is_over(time.monotonic()):
            known = self._places[scene] = await self._find(scene)
        return known

    async def _find(self, scene: str) -> _Place:
        """Ask the service, which may be a cluster's, and connect to what it names."""
        from tigas.http3 import Http3Failed, connected

        try:
            answer = await self._http.get("/config.json", params={"scene": scene})
            config = ServerConfig.model_validate_json(answer.raise_for_status().content)
        except (httpx.HTTPError, ValidationError):
            return _nowhere()
        if config.webtransport_url is None or config.certificate_sha256 is None:
            return _nowhere()
        key = (urlsplit(config.webtransport_url).netloc, config.certificate_sha256)
        connection = self._connections.get(key)
        if connection is None or connection.is_closed:
            try:
                connection = await self._resources.enter_async_context(connected(*key))
            except Http3Failed:
                return _nowhere()
            self._connections[key] = connection
        return _Place(key[0], connection, 0)


def _nowhere() -> _Place:
    return _Place("", None, time.monotonic() + AGAIN_S)
