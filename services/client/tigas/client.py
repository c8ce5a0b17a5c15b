"""The client for programs without an event loop, and for notebooks: the other one, on a thread of its own."""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections.abc import Coroutine, Iterable, Iterator
from types import TracebackType
from typing import Any, Self, TypeVar, Unpack

from PIL import Image

from tigas.async_client import AsyncClient
from tigas.frame import Frame, View
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, ServerConfig

CLOSE_S = 5.0
"""For connections to be closed, in seconds."""

Answered = TypeVar("Answered")


class Client:
    """A render service, or a cluster's address. Everything raises ClientError."""

    def __init__(
        self, url: str = "http://localhost:8080", *, http3: bool = True, verify: bool = True, timeout_s: float = 120
    ) -> None:
        """As AsyncClient's."""
        self._client = AsyncClient(url, http3=http3, verify=verify, timeout_s=timeout_s)
        self._loop = asyncio.new_event_loop()
        thread = threading.Thread(target=self._loop.run_forever, name="tigas client", daemon=True)
        thread.start()
        self.close = weakref.finalize(self, _close, self._client, self._loop, thread)
        """Closes its connections; so do `with`, and the end of the program."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def config(self) -> ServerConfig:
        """What the service says of itself, such as its quality ladder."""
        return self._run(self._client.config())

    def scenes(self) -> list[SceneInfo]:
        """All scenes that it has."""
        return self._run(self._client.scenes())

    def scene(self, scene: str | None = None) -> SceneInfo:
        """A scene by its id, once it is loaded and all of it known; None: the only one."""
        return self._run(self._client.scene(scene))

    def start_pose(self, scene: str | None = None) -> Pose:
        """Where visitors enter a scene."""
        return self._run(self._client.start_pose(scene))

    def render(self, pose: Pose, **view: Unpack[View]) -> Image.Image:
        """The picture from a pose; view: as `View` says, such as scene="garden", size=(640, 360)."""
        return self._run(self._client.render(pose, **view))

    def render_path(self, poses: Iterable[Pose], **view: Unpack[View]) -> Iterator[Image.Image]:
        """The pictures of poses, in their order; a few are on their way at a time."""
        pictures = self._client.render_path(poses, **view)
        try:
            while (picture := self._run(_next(pictures))) is not None:
                yield picture
        finally:
            self._run(pictures.aclose())

    def frame(self, pose: Pose, **view: Unpack[View]) -> Frame:
        """The same as it comes: the file, and the server's times. Raises ValueError for what no view can be."""
        return self._run(self._client.frame(pose, **view))

    def _run(self, asked: Coroutine[Any, Any, Answered]) -> Answered:
        answer = asyncio.run_coroutine_threadsafe(asked, self._loop)
        try:
            return answer.result()
        except BaseException:  # Ctrl+C
            answer.cancel()
            raise


async def _next(pictures: Any) -> Image.Image | None:
    picture: Image.Image | None = await anext(pictures, None)
    return picture


def _close(client: AsyncClient, loop: asyncio.AbstractEventLoop, thread: threading.Thread) -> None:
    try:
        asyncio.run_coroutine_threadsafe(client.aclose(), loop).result(CLOSE_S)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
