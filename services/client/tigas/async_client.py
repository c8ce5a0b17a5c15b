"""Asynchronous client."""

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
from tigas_common.parsing import describe_error
from tigas_common.pose import Pose
from tigas_common.render_requests import SceneHosts, send_with_retries
from tigas_common.sample_cameras import intrinsics as lens
from tigas_common.wire.render import Problem, RenderRequest, SceneInfo, ServerConfig

AT_ONCE = 4
"""Requests in flight: enough to keep a renderer and its encoders busy, and as many as may queue there."""

CLOSED = "The client was closed."

Result = TypeVar("Result")


class AsyncClient:
    """Asynchronous client of a render service or cluster. All methods raise ClientError."""

    def __init__(
        self, url: str = "http://localhost:8080", *, http3: bool = True, verify: bool = True, timeout_s: float = 120
    ) -> None:
        """Create a client, which connects at the first request.

        Args:
            url: The page's URL.
            http3: Request frames over HTTP/3 unless UDP is blocked.
            verify: Verify the certificate of an https:// URL; the service's own is self-signed.
            timeout_s: Timeout for each answer; a scene's first frame waits until the scene is loaded.
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
        """Close the client's connections."""
        if self._http3 is not None:
            await self._http3.aclose()
        await self._http.aclose()

    async def config(self) -> ServerConfig:
        """Return the service's configuration, including its quality ladder."""
        return self._read(TypeAdapter(ServerConfig), await self._ask(lambda: self._http.get("/config.json")))

    async def scenes(self, *, scan: bool = False) -> list[SceneInfo]:
        """List all scenes of the service; `scan` makes it look for new ones first."""
        path = "/scenes?scan=1" if scan else "/scenes"
        return self._read(TypeAdapter(list[SceneInfo]), await self._ask(lambda: self._http.get(path)))

    async def scene(self, scene: str | None = None) -> SceneInfo:
        """Load a scene and return it; None means the only scene."""
        id = scene or await self._only_scene()
        path = f"/scenes/{quote(id, safe='')}/load"
        answer = await self._ask(lambda: self._hosts.request(id, "POST", path, content=None, timeout_s=self._timeout_s))
        return self._read(TypeAdapter(SceneInfo), answer)

    async def start_pose(self, scene: str | None = None) -> Pose:
        """Return the pose of a scene's start camera."""
        info = await self.scene(scene)
        if info.camera is None:
            raise ClientError(f"The scene {info.id!r} has no start camera.")
        return Pose.look_at(info.camera.position, info.camera.look_at, info.up)

    async def render(self, pose: Pose, **view: Unpack[View]) -> Image.Image:
        """Render an image from a pose, with the options of `View`, such as scene="garden", size=(640, 360)."""
        frame = await self.frame(pose, **view)
        return await asyncio.to_thread(lambda: frame.image)

    async def render_path(self, poses: Iterable[Pose], **view: Unpack[View]) -> AsyncGenerator[Image.Image, None]:
        """Render images from poses, in their order, with a few requests in flight."""
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
        """Render an encoded frame with the server's times. Raises ValueError if the view is invalid."""
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
            raise ValueError(describe_error(error)) from None
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
                raise ClientError(f"Choose a scene: {', '.join(ids)}." if ids else "The service has no scenes.")
            self._only = ids[0]
        return self._only

    async def _ask(self, ask: Callable[[], Awaitable[httpx.Response]]) -> httpx.Response:
        """The service's answer, after retries while it is busy."""
        try:
            answer = await send_with_retries(ask)
        except RuntimeError:  # raised by httpx if the client is closed
            if not self._http.is_closed:
                raise
            raise ClientError(CLOSED) from None
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            reason = str(error) or type(error).__name__
            raise Unreachable(f"The render service at {self._http.base_url} does not answer ({reason}).") from None
        if answer.is_success:
            return answer
        try:
            problem = Problem.model_validate_json(answer.content)
        except ValidationError:
            raise Unreachable(f"{self._stranger()} It answered with status {answer.status_code}.") from None
        raise Refused(problem)

    def _read(self, kind: TypeAdapter[Result], answer: httpx.Response) -> Result:
        try:
            return kind.validate_json(answer.content)
        except ValidationError:
            raise Unreachable(self._stranger()) from None

    def _stranger(self) -> str:
        return f"The server at {self._http.base_url} is not a TIGAS render service, or has another version."
