"""Requests of programs to a render service, or to a cluster, whose director names the host of each scene's frames."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Final, Literal

import httpx

from tigas_common.errors import TigasError
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import ServerConfig

TRIES: Final = 5
LATER: Final = (409, 429, 503)
"""Superseded by a newer request; rate limited; overloaded."""
PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 10.0
"""Default and maximum seconds between two tries."""
LOOK_S: Final = 3.0
"""Interval of asking the director for a scene's host, in seconds."""
DOUBT_S: Final = 1.0
"""Minimum interval of asking it about a host that has refused a request, in seconds."""
ANSWER_S: Final = 1.0
"""Timeout of its answer in seconds; after that the host is kept."""
MOST_SCENES: Final = 256
"""Number of scenes with a known host."""


async def retried(ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
    """The first answer that is not for later, or the last one. Raises as `ask` does."""
    for _ in range(TRIES - 1):
        answer = await ask()
        if answer.status_code not in LATER:
            return answer
        told = answer.headers.get("retry-after", "")
        await asyncio.sleep(min(float(told), LONGEST_PAUSE_S) if told.isdecimal() else PAUSE_S)
    return await ask()


@dataclass(frozen=True, slots=True)
class _Host:
    name: str | None
    """Its name; None: there is no cluster."""
    base_url: str
    """Empty: the service itself."""
    asked_at: float


class SceneHosts:
    """The hosts behind one service, which may be the only one."""

    def __init__(self, http: httpx.AsyncClient, clock: Callable[[], float] = time.monotonic) -> None:
        """http: with the service's base URL; clock: in seconds."""
        self._http = http
        self._clock = clock
        self._hosts: dict[str, _Host] = {}

    async def request(
        self, scene: str, method: str, path: str, *, content: str | None, timeout_s: float
    ) -> httpx.Response:
        """Ask the scene's host; if it is down, full or draining, and the director names another, ask that one.

        timeout_s: for each of them. Raises httpx.HTTPError and httpx.InvalidURL.
        """
        host = await self._host_of(scene)
        gone: httpx.TransportError | None = None
        answer: httpx.Response | None = None
        try:
            answer = await self._http.request(method, host.base_url + path, content=content, timeout=timeout_s)
        except httpx.TransportError as error:
            gone = error
        if answer is not None and answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
            return answer
        other = await self._another(scene, host, "lost" if gone else "silent")
        if other is not None:
            return await self._http.request(method, other.base_url + path, content=content, timeout=timeout_s)
        if answer is None:
            assert gone is not None
            raise gone
        return answer

    async def _host_of(self, scene: str) -> _Host:
        known = self._hosts.get(scene)
        if known is None:
            return await self._ask(scene, _Host(None, "", self._clock()))
        if known.name is not None and self._clock() >= known.asked_at + LOOK_S:
            return await self._ask(scene, known, at=known.name)
        return known

    async def _another(self, scene: str, host: _Host, doubt: Literal["silent", "lost"]) -> _Host | None:
        """Where else it may be, if the director thinks so."""
        known = self._hosts.get(scene, host)
        if known.base_url == host.base_url and host.name is not None:
            if doubt == "silent" and self._clock() < known.asked_at + DOUBT_S:
                return None
            known = await self._ask(scene, known, **{doubt: host.name})
        return known if known.base_url != host.base_url else None

    async def _ask(self, scene: str, known: _Host, **about: str) -> _Host:
        """The director's answer; without one, the previous answer."""
        if scene in self._hosts:
            self._hosts[scene] = known = replace(known, asked_at=self._clock())  # so that it is asked once
        try:
            answer = await self._http.get("/config.json", params={"scene": scene, **about}, timeout=ANSWER_S)
            config = parse(ServerConfig, answer.raise_for_status().content, MAX_BODY)
        except (httpx.HTTPError, TigasError):
            return known
        if len(self._hosts) >= MOST_SCENES:
            self._hosts.clear()
        self._hosts[scene] = host = _Host(config.host, config.render_url or "", self._clock())
        return host
