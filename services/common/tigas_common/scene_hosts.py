"""Where a program that knows one address asks for a scene's frames: there, or, if that is a cluster's director, at the
host that it names, since frames do not pass through it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal

import httpx

from tigas_common.errors import TigasError
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.render import ServerConfig

LOOK_S: Final = 3.0
"""How often the director is asked whether a host is still the one, in seconds."""
DOUBT_S: Final = 1.0
"""How often it is asked at most about a host that has refused something, in seconds."""
ANSWER_S: Final = 1.0
"""For it to answer, in seconds; after that all stays as it is."""
MOST_SCENES: Final = 256
"""Whose hosts are remembered."""


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a scene's frames are."""

    host: str | None
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
        self._places: dict[str, _Place] = {}

    async def request(
        self, scene: str, method: str, path: str, *, content: str | None, timeout_s: float
    ) -> httpx.Response:
        """Ask the scene's host; if it is gone, full or draining, and the director names another, then that one.

        timeout_s: for each of them. Raises httpx.HTTPError and httpx.InvalidURL.
        """
        place = await self._place(scene)
        gone: httpx.TransportError | None = None
        answer: httpx.Response | None = None
        try:
            answer = await self._http.request(method, place.base_url + path, content=content, timeout=timeout_s)
        except httpx.TransportError as error:
            gone = error
        if answer is not None and answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
            return answer
        other = await self._another(scene, place, "lost" if gone else "silent")
        if other is not None:
            return await self._http.request(method, other.base_url + path, content=content, timeout=timeout_s)
        if answer is None:
            assert gone is not None
            raise gone
        return answer

    async def _place(self, scene: str) -> _Place:
        known = self._places.get(scene)
        if known is None:
            return await self._ask(scene, _Place(None, "", self._clock()))
        if known.host is not None and self._clock() >= known.asked_at + LOOK_S:
            return await self._ask(scene, known, at=known.host)
        return known

    async def _another(self, scene: str, place: _Place, doubt: Literal["silent", "lost"]) -> _Place | None:
        """Where else it may be, if the director thinks so."""
        known = self._places.get(scene, place)
        if known.base_url == place.base_url and place.host is not None:
            if doubt == "silent" and self._clock() < known.asked_at + DOUBT_S:
                return None
            known = await self._ask(scene, known, **{doubt: place.host})
        return known if known.base_url != place.base_url else None

    async def _ask(self, scene: str, known: _Place, **about: str) -> _Place:
        """What the director says; what was known if it says nothing."""
        if scene in self._places:
            self._places[scene] = known = replace(known, asked_at=self._clock())  # so that it is asked once
        try:
            answer = await self._http.get("/config.json", params={"scene": scene, **about}, timeout=ANSWER_S)
            config = parse(ServerConfig, answer.raise_for_status().content, MAX_BODY)
        except (httpx.HTTPError, TigasError):
            return known
        if len(self._places) >= MOST_SCENES:
            self._places.clear()
        self._places[scene] = place = _Place(config.host, config.render_url or "", self._clock())
        return place
