"""Training pairs: a view's frame at each low rung, and the same view lossless at display size.

Cameras are on movements around a scene's start camera and its subject. Held-out views are on separate movements, and no
training view is next to one of them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count, islice
from random import Random

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.sample_cameras import SceneAxes, along, intrinsics
from tigas_common.wire.render import RenderRequest, Rung, SceneInfo
from tigas_enhance.renderer import Pixels, Renderer

WORKERS = 3
"""Views that are rendered at a time."""
POSES_PER_VIEW = 4
"""Maximum number of poses tried for a view that shows something."""
LEAST_CONTENT = 0.04
"""The share of a view's pixels that must show something other than the background."""
LEAST_VIEWS = 4
"""Views that are rendered even after the time is up."""
MOST_HELD_OUT = 96
"""Views that may be asked for to test."""


class NothingToLearn(StartError):
    """No view of the scene shows anything, or the ladder has no rung below the best."""


@dataclass(frozen=True, slots=True)
class Pair:
    """One view."""

    full: Pixels
    """[H, W, 3] Displayed sRGB."""
    content: NDArray[np.bool_]
    """[H, W], where it is not the background."""
    rungs: dict[int, Pixels]
    """[h, w, 3] by rung: the decoded frames."""


@dataclass(frozen=True, slots=True)
class ScenePairs:
    """The pairs of a scene, at some rungs of its ladder. Methods raise as those of Renderer, and NothingToLearn."""

    renderer: Renderer
    scene: SceneInfo
    ladder: Sequence[Rung]
    rungs: Sequence[int]

    def training(self, number: int, until: float) -> list[Pair]:
        """Up to `number` views, or as many as are rendered until a time of the monotonic clock."""
        return self._several(islice(training_views(self.scene), POSES_PER_VIEW * number), number, until)

    def held_out(self, number: int) -> list[Pair]:
        """Views that no training sees."""
        return self._several(held_out_views(self.scene, POSES_PER_VIEW * number), number, float("inf"))

    def _several(self, poses: Iterable[Pose], number: int, until: float) -> list[Pair]:
        found: list[Pair] = []
        for pair in self._rendered(iter(poses)):
            found.append(pair)
            if len(found) >= number or (len(found) >= LEAST_VIEWS and time.monotonic() > until):
                break
        if not found:
            raise NothingToLearn("All views of the scene are empty.")
        return found

    def _rendered(self, poses: Iterator[Pose]) -> Iterator[Pair]:
        """The views that show something, in order."""
        pool = ThreadPoolExecutor(WORKERS)

        def begun(number: int) -> list[Future[Pair | None]]:
            return [pool.submit(self._pair, pose) for pose in islice(poses, number)]

        try:
            running = deque(begun(WORKERS))
            while running:
                pair = running.popleft().result()
                running.extend(begun(1))
                if pair is not None:
                    yield pair
        finally:
            pool.shutdown(cancel_futures=True)

    def _pair(self, pose: Pose) -> Pair | None:
        """One view at the best rung's size, and its frames; None if it shows next to nothing."""
        scene, lens = self.scene, intrinsics(self.ladder[0].width, self.ladder[0].height)
        full = self.renderer.picture(RenderRequest.at(scene.id, pose, lens, format="png"))
        background = np.round(np.array(scene.background) * 255).astype(np.int16)
        content = (np.abs(full.astype(np.int16) - background) > 1).any(axis=2)
        if content.mean() < LEAST_CONTENT:
            return None
        picture = self.renderer.picture
        frames = {rung: picture(RenderRequest.at(scene.id, pose, lens, profile=rung)) for rung in self.rungs}
        return Pair(full, content, frames)


def held_out_views(scene: SceneInfo, number: int) -> list[Pose]:
    """The views of a scene that no training sees; the same ones for the same scene. Raises StartError."""
    return list(islice(_views(_axes(scene), Random(f"held out {scene.id}")), number))


def training_views(scene: SceneInfo) -> Iterator[Pose]:
    """Views without end, none of them a neighbour of a held-out one. Raises StartError."""
    axes = _axes(scene)
    held_out = held_out_views(scene, MOST_HELD_OUT)
    for pose in _views(axes, Random(f"training {scene.id} 0")):
        if not any(axes.are_neighbours(pose, other) for other in held_out):
            yield pose


def _views(axes: SceneAxes, chance: Random) -> Iterator[Pose]:
    for number in count():
        yield from along(axes.orbit(chance) if number % 2 else axes.walk(chance), chance)


def _axes(scene: SceneInfo) -> SceneAxes:
    if scene.camera is None:
        raise StartError(f"The scene {scene.id} has no start camera.")
    return SceneAxes.of(scene.camera, scene.up)
