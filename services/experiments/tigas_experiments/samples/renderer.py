"""A client of the render service or a cluster for single frames, with long timeouts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from typing import Self, TypeVar
from urllib.parse import quote

import httpx
from pydantic import ValidationError

from tigas_common.errors import StartError
from tigas_common.render_requests import SceneHosts, retried
from tigas_common.wire.render import Problem, RenderRequest, SceneInfo, ServerConfig

AT_ONCE = 4
"""Frames that are asked for: enough to keep a renderer and the encoders behind it busy."""
LOAD_S = 300
FRAME_S = 60
Item = TypeVar("Item")


class RendererAway(StartError):
    """Reason why the service is unavailable, in one sentence."""


class NotRendered(Exception):
    """Reason why one frame is unavailable, in one sentence; others may succeed."""


async def concurrently(items: Iterable[Item], work: Callable[[Item], Awaitable[None]]) -> None:
    """Process items with AT_ONCE workers. Raises the first RendererAway or OSError of a worker."""
    left = iter(items)

    async def worker() -> None:
        for item in left:
            await work(item)

    try:
        async with asyncio.TaskGroup() as group:
            for _ in range(AT_ONCE):
                group.create_task(worker())
    except* (RendererAway, OSError) as errors:
        raise errors.exceptions[0] from None


class Renderer:
    """One render service or cluster. The caller limits concurrency."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http
        self._hosts = SceneHosts(http)

    @classmethod
    @asynccontextmanager
    async def at(cls, url: str) -> AsyncIterator[Self]:
        """A client for a URL during the context."""
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
            raise RendererAway(f"The server at {self._http.base_url} is no TIGAS render service.") from None

    async def frame(self, request: RenderRequest) -> bytes:
        """The frame that was asked for. Raises RendererAway and NotRendered."""
        body = request.model_dump_json(exclude_none=True)
        answer = await self._ask(
            lambda: self._hosts.request(request.scene, "POST", "/render", content=body, timeout_s=FRAME_S)
        )
        return answer.content

    async def config(self) -> ServerConfig:
        """The service's configuration, such as its ladder. Raises RendererAway and NotRendered."""
        answer = await self._ask(lambda: self._http.get("/config.json", timeout=FRAME_S))
        try:
            return ServerConfig.model_validate_json(answer.content)
        except ValidationError:
            raise RendererAway(f"The server at {self._http.base_url} is no TIGAS render service.") from None

    async def _ask(self, ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
        try:
            answer = await retried(ask)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            reason = str(error) or type(error).__name__
            raise RendererAway(f"The render service at {self._http.base_url} does not answer ({reason}).") from None
        if answer.is_success:
            return answer
        try:
            detail = Problem.model_validate_json(answer.content).detail
        except ValidationError:
            raise RendererAway(
                f"The server at {self._http.base_url} is no TIGAS render service: it says {answer.status_code}."
            ) from None
        raise NotRendered(detail)
