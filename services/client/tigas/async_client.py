"""The client for programs with an event loop."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable
from types import TracebackType
from typing import Self, TypeVar, Unpack
from urllib.parse import quote

import httpx
from PIL import Image
from pydantic import TypeAdapter, ValidationError

from tigas.errors import ClientError, Refused, Unreachable
from tigas.frame import Frame, View, read_timing
from tigas.http3_hosts import Http3Hosts
from tigas_common.asking_again import asked_again
from tigas_common.parsing import sentence
from tigas_common.pose import Pose
from tigas_common.scene_hosts import SceneHosts
from tigas_common.standpoints import intrinsics as lens
from tigas_common.wire.render import Problem, RenderRequest, SceneInfo, ServerConfig

AT_ONCE = 4
"""Frames that are asked for: enough to keep a renderer and its encoders busy, and as many as may wait there."""

Answered = TypeVar("Answered")


class AsyncClient:
    """A render service, or a cluster's address. Everything raises ClientError."""

    def __init__(
        self, url: str = "http://localhost:8080", *, http3: bool = True, verify: bool = True, timeout_s: float = 120
    ) -> None:
        """url: of the page.

        http3: ask for frames over HTTP/3 if aioquic is installed and UDP gets there.
        verify: check the certificate of an https:// URL; the service's own is known to no authority.
        timeout_s: for each answer. The first frame of a scene comes when it is loaded.
        """
        self._timeout_s = timeout_s
        self._http = httpx.AsyncClient(base_url=url, timeout=timeout_s, verify=verify, trust_env=False)
        self._hosts = SceneHosts(self._http)
        self._http3 = Http3Hosts(self._http) if http3 else None
        self._only: str | None = None
        self._turns = asyncio.Semaphore(AT_ONCE)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close its connections."""
        if self._http3 is not None:
            await self._http3.aclose()
        await self._http.aclose()

    async def config(self) -> ServerConfig:
        """What the service says of itself, such as its quality ladder."""
        return self._read(TypeAdapter(ServerConfig), await self._ask(lambda: self._http.get("/config.json")))

    async def scenes(self) -> list[SceneInfo]:
        """All scenes that it has."""
        return self._read(TypeAdapter(list[SceneInfo]), await self._ask(lambda: self._http.get("/scenes")))

    async def scene(self, scene: str | None = None) -> SceneInfo:
        """A scene by its id, once it is loaded and all of it known; None: the only one."""
        id = scene or await self._only_scene()
        path = f"/scenes/{quote(id, safe='')}/load"
        answer = await self._ask(lambda: self._hosts.request(id, "POST", path, content=None, timeout_s=self._timeout_s))
        return self._read(TypeAdapter(SceneInfo), answer)

    async def start_pose(self, scene: str | None = None) -> Pose:
        """Where visitors enter a scene."""
        info = await self.scene(scene)
        if info.camera is None:
            raise ClientError(f"The scene {info.id!r} has no start camera.")
        return Pose.look_at(info.camera.position, info.camera.look_at, info.up)

    async def render(self, pose: Pose, **view: Unpack[View]) -> Image.Image:
        """The picture from a pose; view: as `View` says, such as scene="garden", size=(640, 360)."""
        frame = await self.frame(pose, **view)
        return await asyncio.to_thread(lambda: frame.image)

    async def render_path(self, poses: Iterable[Pose], **view: Unpack[View]) -> AsyncGenerator[Image.Image, None]:
        """The pictures of poses, in their order; a few are on their way at a time."""
        running: deque[asyncio.Task[Image.Image]] = deque()
        try:
            for pose in poses:
                running.append(asyncio.create_task(self.render(pose, **view)))
                if len(running) == AT_ONCE:
                    yield await running.popleft()
            while running:
                yield await running.popleft()
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    async def frame(self, pose: Pose, **view: Unpack[View]) -> Frame:
        """The same as it comes: the file, and the server's times. Raises ValueError for what no view can be."""
        scene = view.get("scene") or await self._only_scene()
        try:
            request = RenderRequest.at(
                scene,
                pose,
                view.get("intrinsics") or lens(*view.get("size", (1280, 720))),
                profile=view.get("profile"),
                format=view.get("format", "jpeg"),
            )
        except ValidationError as error:
            raise ValueError(sentence(error)) from None
        body = request.model_dump_json(exclude_none=True)
        async with self._turns:
            answer = await self._ask(lambda: self._post(scene, body))
        return Frame(
            answer.content,
            answer.headers.get("content-type", ""),
            read_timing(answer.headers.get("server-timing", "")),
            answer.http_version,
        )

    async def _post(self, scene: str, body: str) -> httpx.Response:
        if self._http3 is not None:
            answer = await self._http3.post(scene, "/render", body, self._timeout_s)
            if answer is not None:
                return answer
        return await self._hosts.request(scene, "POST", "/render", content=body, timeout_s=self._timeout_s)

    async def _only_scene(self) -> str:
        if self._only is None:
            ids = [each.id for each in await self.scenes() if each.state != "broken"]
            if len(ids) != 1:
                raise ClientError(f"Say which scene: {', '.join(ids)}." if ids else "The service has no scene.")
            self._only = ids[0]
        return self._only

    async def _ask(self, ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
        """The answer of a service that is asked again while it has no time."""
        try:
            answer = await asked_again(ask)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            reason = str(error) or type(error).__name__
            raise Unreachable(f"The render service at {self._http.base_url} does not answer ({reason}).") from None
        if answer.is_success:
            return answer
        try:
            problem = Problem.model_validate_json(answer.content)
        except ValidationError:
            raise Unreachable(f"{self._stranger()} It says {answer.status_code}.") from None
        raise Refused(problem)

    def _read(self, kind: TypeAdapter[Answered], answer: httpx.Response) -> Answered:
        try:
            return kind.validate_json(answer.content)
        except ValidationError:
            raise Unreachable(self._stranger()) from None

    def _stranger(self) -> str:
        return f"What answers at {self._http.base_url} is no TIGAS render service, or one of another version."
