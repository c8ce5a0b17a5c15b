"""A render service that provides views, usable from any thread."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

import numpy as np
from anyio.from_thread import BlockingPortal, start_blocking_portal
from numpy.typing import NDArray
from PIL import Image

from tigas_common.render_requests import RenderClient, RenderUnavailable
from tigas_common.wire.render import RenderRequest, Rung, SceneInfo

Pixels = NDArray[np.uint8]


class Renderer:
    """A client of a render service, usable from any thread. Methods raise RenderUnavailable and RenderProblem."""

    def __init__(self, portal: BlockingPortal, client: RenderClient) -> None:
        self._portal = portal
        self._client = client

    @classmethod
    @contextmanager
    def connect(cls, url: str) -> Iterator[Self]:
        """Connect to the service at a URL during the context."""
        with start_blocking_portal() as portal, portal.wrap_async_context_manager(RenderClient.connect(url)) as client:
            yield cls(portal, client)

    def ladder(self, scene: SceneInfo) -> tuple[Rung, ...]:
        return scene.ladder or self._portal.call(self._client.config).ladder

    def load(self, scene_id: str) -> SceneInfo:
        """Load a scene, so that its camera and its file's digest are known."""
        return self._portal.call(self._client.load, scene_id)

    def picture(self, request: RenderRequest) -> Pixels:
        """Pixels [H, W, 3] of a frame."""
        body = self._portal.call(self._client.frame, request)
        try:
            return np.asarray(Image.open(io.BytesIO(body)).convert("RGB"))
        except OSError:
            raise RenderUnavailable("The render service's answer is not an image.") from None
