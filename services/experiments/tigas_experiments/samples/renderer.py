"""The render service or a cluster, asked for one frame after another, with the patience that nobody has who watches."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Self
from urllib.parse import quote

import httpx
from pydantic import ValidationError

from tigas_common.asking_again import asked_again
from tigas_common.scene_hosts import SceneHosts
from tigas_common.wire.render import Problem, RenderRequest, SceneInfo, ServerConfig

AT_ONCE = 4
"""Frames that are asked for: enough to keep a renderer and the encoders behind it busy."""
LOAD_S = 300
FRAME_S = 60


class RendererAway(Exception):
    """Why no frame at all can be had, in one sentence."""


class NotRendered(Exception):
    """Why one frame cannot be had, in one sentence; others may be."""


class Renderer:
    """One render service, or a cluster's. Its caller says how often it is asked at once."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http
        self._hosts = SceneHosts(http)

    @classmethod
    @asynccontextmanager
    async def at(cls, url: str) -> AsyncIterator[Self]:
        """The one at a URL, for as long as the context lasts."""
        limits = httpx.Limits(max_connections=AT_ONCE)
        async with httpx.AsyncClient(base_url=url, trust_env=False, verify=False, limits=limits) as http:
            yield cls(http)

    async def load(self, scene: str) -> SceneInfo:
        """A scene's description, once it is loaded. Raises RendererAway and NotRendered."""
        path = f"/scenes/{quote(scene, safe='')}/load"
        answer = await self._ask(lambda: self._hosts.request(scene, "POST", path, content=None, timeout_s=LOAD_S))
        try:
            return SceneInfo.model_validate_json(answer.content)
        except ValidationError:
            raise RendererAway(f"What answers at {self._http.base_url} is no TIGAS render service.") from None

    async def frame(self, request: RenderRequest) -> bytes:
        """The frame that was asked for. Raises RendererAway and NotRendered."""
        body = request.model_dump_json(exclude_none=True)
        answer = await self._ask(
            lambda: self._hosts.request(request.scene, "POST", "/render", content=body, timeout_s=FRAME_S)
        )
        return answer.content

    async def config(self) -> ServerConfig:
        """What the service says of itself, such as its ladder. Raises RendererAway and NotRendered."""
        answer = await self._ask(lambda: self._http.get("/config.json", timeout=FRAME_S))
        try:
            return ServerConfig.model_validate_json(answer.content)
        except ValidationError:
            raise RendererAway(f"What answers at {self._http.base_url} is no TIGAS render service.") from None

    async def _ask(self, ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
        try:
            answer = await asked_again(ask)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            reason = str(error) or type(error).__name__
            raise RendererAway(f"The render service at {self._http.base_url} does not answer ({reason}).") from None
        if answer.is_success:
            return answer
        try:
            detail = Problem.model_validate_json(answer.content).detail
        except ValidationError:
            raise RendererAway(
                f"What answers at {self._http.base_url} is no TIGAS render service: it says {answer.status_code}."
            ) from None
        raise NotRendered(detail)
