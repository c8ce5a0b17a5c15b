"""Synchronous client, for scripts and notebooks: runs AsyncClient on a background thread."""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections.abc import Coroutine, Iterable, Iterator
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Any, Self, TypeVar, Unpack

from PIL import Image

from tigas.async_client import CLOSED, AsyncClient
from tigas.errors import ClientError
from tigas.frame import Frame, View
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, ServerConfig

CLOSE_S = 5.0
"""Timeout for closing connections, in seconds."""

Result = TypeVar("Result")


class Client:
    """Synchronous client of a render service or cluster. All methods raise ClientError."""

    def __init__(
        self, url: str = "http://localhost:8080", *, http3: bool = True, verify: bool = True, timeout_s: float = 120
    ) -> None:
        """Take the same arguments as AsyncClient."""
        self._client = AsyncClient(url, http3=http3, verify=verify, timeout_s=timeout_s)
        self._loop = asyncio.new_event_loop()
        thread = threading.Thread(target=self._loop.run_forever, name="tigas client", daemon=True)
        thread.start()
        self.close = weakref.finalize(self, _close, self._client, self._loop, thread)
        """Close the connections, as `with` and the end of the program do."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def config(self) -> ServerConfig:
        """Return the service's configuration, including its quality ladder."""
        return self._run(self._client.config())

    def scenes(self, *, scan: bool = False) -> list[SceneInfo]:
        """List all scenes of the service; `scan` makes it look for new ones first."""
        return self._run(self._client.scenes(scan=scan))

    def scene(self, scene: str | None = None) -> SceneInfo:
        """Load a scene and return it; None means the only scene."""
        return self._run(self._client.scene(scene))

    def start_pose(self, scene: str | None = None) -> Pose:
        """Return the pose of a scene's start camera."""
        return self._run(self._client.start_pose(scene))

    def render(self, pose: Pose, **view: Unpack[View]) -> Image.Image:
        """Render an image from a pose, with the options of `View`, such as scene="garden", size=(640, 360)."""
        return self._run(self._client.render(pose, **view))

    def render_path(self, poses: Iterable[Pose], **view: Unpack[View]) -> Iterator[Image.Image]:
        """Render images from poses, in order, with a few requests in flight."""
        pictures = self._client.render_path(poses, **view)
        try:
            while (picture := self._run(_next(pictures))) is not None:
                yield picture
        finally:
            if self.close.alive:
                self._run(_closed(pictures))

    def frame(self, pose: Pose, **view: Unpack[View]) -> Frame:
        """Render an encoded frame with the server's times. Raises ValueError if the view is invalid."""
        return self._run(self._client.frame(pose, **view))

    def _run(self, asked: Coroutine[Any, Any, Result]) -> Result:
        if not self.close.alive:
            asked.close()
            raise ClientError(CLOSED)
        answer = asyncio.run_coroutine_threadsafe(asked, self._loop)
        try:
            return answer.result()
        except CancelledError:
            raise ClientError(CLOSED) from None
        except BaseException:  # Ctrl+C
            answer.cancel()
            raise


async def _next(pictures: Any) -> Image.Image | None:
    picture: Image.Image | None = await anext(pictures, None)
    return picture


async def _closed(pictures: Any) -> None:
    """Close a generator once it has finished the step that Ctrl+C cancelled."""
    while pictures.ag_running:  # noqa: ASYNC110 - nothing announces it
        await asyncio.sleep(0.001)
    await pictures.aclose()


async def _end(client: AsyncClient) -> None:
    """Cancel requests of other threads, and close the client."""
    running = asyncio.all_tasks() - {asyncio.current_task()}
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    await client.aclose()


def _close(client: AsyncClient, loop: asyncio.AbstractEventLoop, thread: threading.Thread) -> None:
    try:
        asyncio.run_coroutine_threadsafe(_end(client), loop).result(CLOSE_S)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
