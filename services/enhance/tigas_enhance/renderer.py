"""The render service that views come from: one at a URL, or one started for them."""

from __future__ import annotations

import io
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

import numpy as np
from anyio.from_thread import BlockingPortal, start_blocking_portal
from numpy.typing import NDArray
from PIL import Image

from tigas_common.errors import StartError
from tigas_common.processes import running, tigas
from tigas_common.render_requests import RenderClient, RenderUnavailable
from tigas_common.wire.render import RenderRequest, Rung, SceneInfo

STOP_S = 5

Pixels = NDArray[np.uint8]


class Renderer:
    """A render service, asked from any thread. Methods raise RenderUnavailable and RenderProblem."""

    def __init__(self, portal: BlockingPortal, client: RenderClient) -> None:
        self._portal = portal
        self._client = client

    @classmethod
    @contextmanager
    def at(cls, url: str) -> Iterator[Self]:
        """The service at a URL during the context."""
        with start_blocking_portal() as portal, portal.wrap_async_context_manager(RenderClient.at(url)) as client:
            yield cls(portal, client)

    def ladder(self, scene: SceneInfo) -> tuple[Rung, ...]:
        return scene.ladder or self._portal.call(self._client.config).ladder

    def load(self, scene_id: str) -> SceneInfo:
        """A scene that is loaded, so that its camera and its file's digest are known."""
        return self._portal.call(self._client.load, scene_id)

    def picture(self, request: RenderRequest) -> Pixels:
        """A frame's pixels [H, W, 3]."""
        body = self._portal.call(self._client.frame, request)
        try:
            return np.asarray(Image.open(io.BytesIO(body)).convert("RGB"))
        except OSError:
            raise RenderUnavailable("The render service answered with something that is no picture.") from None


@contextmanager
def render_service(device: str, *, own_ladders: bool = True) -> Iterator[str]:
    """Run a render service on this machine until the context ends, and give its URL. Raises StartError.

    own_ladders: whether scenes have their own ladders, or all have the paper's.
    """
    ladder = "scene" if own_ladders else "paper"
    options = ["--http", "127.0.0.1:0", "--quic", "off", "--device", device, "--ladder", ladder]
    with running(tigas("render", *options), STOP_S, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdout is not None
        last = "it says nothing"
        for line in process.stdout:
            last = line.decode(errors="replace").strip() or last
            if found := re.search(r"Open (http://\S+)/", last):
                break
        else:
            raise StartError(f"The render service did not start: {last}")
        yield found[1]  # and hardly any output after it, as a service without visitors has little to report
