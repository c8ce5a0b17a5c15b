"""Training pairs: a view's frame at each low rung, and the same view lossless at display size."""

from __future__ import annotations

import io
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from types import TracebackType
from typing import TypeVar
from urllib.parse import quote

import httpx
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.errors import TigasError
from tigas_common.parsing import parse
from tigas_common.pose import Pose
from tigas_common.sample_cameras import intrinsics
from tigas_common.wire.render import Problem, RenderRequest, Rung, SceneInfo, ServerConfig
from tigas_enhance.errors import NothingToLearn, RenderFailed

TIMEOUT_S = 120
"""Loading a large scene takes long."""
MAX_ANSWER = 1_000_000
PATIENCE = 6
"""Maximum number of attempts at a busy service."""
BUSY = frozenset({409, 429, 503, 504})
LEAST_CONTENT = 0.04
"""The share of a view's pixels that must show something other than the background."""

Pixels = NDArray[np.uint8]
Message = TypeVar("Message")


@dataclass(frozen=True, slots=True)
class Pair:
    """One view."""

    full: Pixels
    """[H, W, 3] Displayed sRGB."""
    content: NDArray[np.bool_]
    """[H, W], where it is not the background."""
    rungs: dict[int, Pixels]
    """[h, w, 3] by rung: the decoded frames."""


class Renderer:
    """A render service over HTTP. All methods raise RenderFailed."""

    def __init__(self, url: str, workers: int = 3) -> None:
        self._http = httpx.Client(base_url=url, timeout=TIMEOUT_S, trust_env=False)
        self._workers = workers
        self._pool = ThreadPoolExecutor(workers)

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=True)
        self._http.close()

    def ladder(self, scene: SceneInfo) -> tuple[Rung, ...]:
        """The ladder of a scene."""
        return scene.ladder or _read(ServerConfig, self._ask("GET", "/config.json")).ladder

    def load(self, scene_id: str) -> SceneInfo:
        """A scene that is loaded, so that its camera and its file's digest are known."""
        return _read(SceneInfo, self._ask("POST", f"/scenes/{quote(scene_id, safe='')}/load"))

    def pairs(
        self, scene: SceneInfo, ladder: Sequence[Rung], rungs: Sequence[int], poses: Iterable[Pose]
    ) -> Iterator[Pair]:
        """The views that show something, in order; as many at once as there are workers."""
        waiting = iter(poses)

        def begun(number: int) -> list[Future[Pair | None]]:
            return [self._pool.submit(self.pair, scene, ladder, rungs, pose) for pose in islice(waiting, number)]

        running = deque(begun(self._workers))
        while running:
            pair = running.popleft().result()
            running.extend(begun(1))
            if pair is not None:
                yield pair

    def pair(self, scene: SceneInfo, ladder: Sequence[Rung], rungs: Sequence[int], pose: Pose) -> Pair | None:
        """One view at the best rung's size, and its frames of these rungs; None if it shows next to nothing."""
        lens = intrinsics(ladder[0].width, ladder[0].height)
        full = self.picture(RenderRequest.at(scene.id, pose, lens, format="png"))
        background = np.round(np.array(scene.background) * 255).astype(np.int16)
        content = (np.abs(full.astype(np.int16) - background) > 1).any(axis=2)
        if content.mean() < LEAST_CONTENT:
            return None
        frames = {rung: self.picture(RenderRequest.at(scene.id, pose, lens, profile=rung)) for rung in rungs}
        return Pair(full, content, frames)

    def picture(self, request: RenderRequest) -> Pixels:
        """A frame's pixels [H, W, 3]."""
        body = self._ask("POST", "/render", request.model_dump_json(exclude_none=True))
        try:
            return np.asarray(Image.open(io.BytesIO(body)).convert("RGB"))
        except OSError:
            raise RenderFailed("The render service answered with something that is no picture.") from None

    def _ask(self, method: str, path: str, content: str | None = None) -> bytes:
        for attempt in range(PATIENCE):
            try:
                answer = self._http.request(method, path, content=content)
            except httpx.HTTPError as error:
                raise RenderFailed(f"The render service does not answer: {error or type(error).__name__}.") from None
            if answer.is_success:
                return answer.content
            if answer.status_code not in BUSY:
                break
            time.sleep(0.1 * 2**attempt)
        raise RenderFailed(f"The render service answered {answer.status_code}: {_detail(answer)}")


def several(pairs: Iterator[Pair], number: int, until: float = float("inf"), least: int = 4) -> list[Pair]:
    """Up to `count` pairs, or, after a minimum, as many as arrive until a time of the monotonic clock.

    Raises NothingToLearn.
    """
    found: list[Pair] = []
    for pair in pairs:
        found.append(pair)
        if len(found) >= number or (len(found) >= least and time.monotonic() > until):
            break
    if not found:
        raise NothingToLearn("No view of the scene shows anything.")
    return found


def _read(kind: type[Message], body: bytes) -> Message:
    try:
        return parse(kind, body, MAX_ANSWER)
    except TigasError as error:
        raise RenderFailed(
            f"The render service, of another version perhaps, is not understood: {error.detail}"
        ) from None


def _detail(answer: httpx.Response) -> str:
    try:
        return parse(Problem, answer.content).detail
    except TigasError:
        return answer.reason_phrase
