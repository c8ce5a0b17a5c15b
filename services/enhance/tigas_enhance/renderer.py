"""The render service that views come from: one at a URL, or one started for them."""

from __future__ import annotations

import io
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar
from urllib.parse import quote

import httpx
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.errors import StartError, TigasError
from tigas_common.parsing import parse
from tigas_common.processes import running, tigas
from tigas_common.wire.render import Problem, RenderRequest, Rung, SceneInfo, ServerConfig

TIMEOUT_S = 120
"""Loading a large scene takes long."""
STOP_S = 5
MAX_ANSWER = 1_000_000
TRIES = 6
"""Maximum number of attempts at a busy service."""
BUSY = frozenset({409, 429, 503, 504})

Pixels = NDArray[np.uint8]
Message = TypeVar("Message")


class RenderFailed(StartError):
    """The render service did not deliver a requested frame."""


class Renderer:
    """A render service over HTTP. All methods raise RenderFailed, and may be called in any thread."""

    def __init__(self, url: str) -> None:
        self._http = httpx.Client(base_url=url, timeout=TIMEOUT_S, trust_env=False)
        self.close = self._http.close

    def ladder(self, scene: SceneInfo) -> tuple[Rung, ...]:
        """The ladder of a scene."""
        return scene.ladder or _read(ServerConfig, self._ask("GET", "/config.json")).ladder

    def load(self, scene_id: str) -> SceneInfo:
        """A scene that is loaded, so that its camera and its file's digest are known."""
        return _read(SceneInfo, self._ask("POST", f"/scenes/{quote(scene_id, safe='')}/load"))

    def picture(self, request: RenderRequest) -> Pixels:
        """A frame's pixels [H, W, 3]."""
        body = self._ask("POST", "/render", request.model_dump_json(exclude_none=True))
        try:
            return np.asarray(Image.open(io.BytesIO(body)).convert("RGB"))
        except OSError:
            raise RenderFailed("The render service answered with something that is no picture.") from None

    def _ask(self, method: str, path: str, content: str | None = None) -> bytes:
        for attempt in range(TRIES):
            try:
                answer = self._http.request(method, path, content=content)
            except httpx.HTTPError as error:
                raise RenderFailed(f"The render service does not answer: {error or type(error).__name__}.") from None
            if answer.is_success:
                return answer.content
            if answer.status_code not in BUSY:
                break
            time.sleep(0.1 * 2**attempt)
        try:
            detail = parse(Problem, answer.content).detail
        except TigasError:
            detail = answer.reason_phrase
        raise RenderFailed(f"The render service answered {answer.status_code}: {detail}")


@contextmanager
def render_service(device: str, *, own_ladders: bool = True) -> Iterator[str]:
    """Run a render service on this machine until the context ends, and give its URL. Raises RenderFailed.

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
            raise RenderFailed(f"The render service did not start: {last}")
        yield found[1]  # and hardly any output after it, as a service without visitors has little to report


def _read(kind: type[Message], body: bytes) -> Message:
    try:
        return parse(kind, body, MAX_ANSWER)
    except TigasError as error:
        raise RenderFailed(
            f"The render service, of another version perhaps, is not understood: {error.detail}"
        ) from None
