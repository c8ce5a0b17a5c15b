"""HTTP/3 connections to the hosts of scenes, if UDP gets through."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass
from urllib.parse import urlsplit

import httpx
from pydantic import ValidationError

from tigas.http3 import Http3Connection, Http3Failed, connected
from tigas_common.wire.render import ServerConfig

AGAIN_S = 30.0
"""Seconds for which HTTP/1.1 is used after a failure."""


@dataclass(frozen=True, slots=True)
class _Host:
    """Source of a scene's frames."""

    authority: str
    connection: Http3Connection | None
    """None: HTTP/1.1 is used until `again_at`."""
    again_at: float

    def is_over(self, now: float) -> bool:
        """Whether the host has to be looked up again."""
        return now >= self.again_at if self.connection is None else self.connection.is_closed


class Http3Hosts:
    """HTTP/3 connections of one client."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http
        self._hosts: dict[str, _Host] = {}
        self._connections: dict[tuple[str, str], tuple[Http3Connection, AsyncExitStack]] = {}
        """Connections by authority and certificate, with their exit stacks."""
        self._connecting = asyncio.Lock()

    async def aclose(self) -> None:
        """Close all connections."""
        for _, resources in self._connections.values():
            await resources.aclose()

    async def post(self, scene: str, path: str, body: str, timeout_s: float) -> httpx.Response | None:
        """The response of the scene's host over HTTP/3; None if the request should be made over HTTP/1.1."""
        async with self._connecting:
            host = await self._host_of(scene)
        if host.connection is None:
            return None
        try:
            async with asyncio.timeout(timeout_s):
                answer = await host.connection.post(host.authority, path, body.encode())
            if answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
                return answer
        except (Http3Failed, TimeoutError):
            pass
        self._hosts[scene] = _nowhere()
        return None

    async def _host_of(self, scene: str) -> _Host:
        known = self._hosts.get(scene)
        if known is None or known.is_over(time.monotonic()):
            known = self._hosts[scene] = await self._find(scene)
        return known

    async def _find(self, scene: str) -> _Host:
        """Connect to the scene's host, as given by the service or by the director of a cluster."""
        try:
            answer = await self._http.get("/config.json", params={"scene": scene})
            config = ServerConfig.model_validate_json(answer.raise_for_status().content)
        except (httpx.HTTPError, ValidationError):
            return _nowhere()
        if config.webtransport_url is None or config.certificate_sha256 is None:
            return _nowhere()
        key = (urlsplit(config.webtransport_url).netloc, config.certificate_sha256)
        try:
            return _Host(key[0], await self._connection(key), 0)
        except Http3Failed:
            return _nowhere()

    async def _connection(self, key: tuple[str, str]) -> Http3Connection:
        """An open connection, replacing one that has ended. Raises Http3Failed."""
        for ended in [other for other, (connection, _) in self._connections.items() if connection.is_closed]:
            _, resources = self._connections.pop(ended)
            await resources.aclose()
        if key not in self._connections:
            async with AsyncExitStack() as stack:
                self._connections[key] = await stack.enter_async_context(connected(*key)), stack.pop_all()
        return self._connections[key][0]


def _nowhere() -> _Host:
    return _Host("", None, time.monotonic() + AGAIN_S)
