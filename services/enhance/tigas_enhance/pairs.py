"""Training pairs: a view's frame at each low rung, and the same view, lossless, at display size.

Cameras move around a scene's start camera and its subject. Held-out views are on separate movements, and no training
view is close to one of them.
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
from tigas_common.sample_cameras import SceneAxes, intrinsics, sample_movement
from tigas_common.wire.render import RenderRequest, Rung, SceneInfo
from tigas_enhance.renderer import Pixels, Renderer

WORKERS = 3
"""Number of views rendered at a time."""
POSES_PER_VIEW = 4
"""Maximum number of poses tried for a view that is not empty."""
MIN_CONTENT = 0.04
"""Minimum share of a view's pixels that show something other than the background."""
MIN_VIEWS = 4
"""Number of views rendered even if the time is up."""
MAX_HELD_OUT = 96
"""Maximum number of views for testing."""


class NoTrainingData(StartError):
    """All views of the scene are empty, or the ladder has no rung below the best."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A view at display size, and its frames at low rungs."""

    full: Pixels
    """[H, W, 3] sRGB as displayed."""
    content: NDArray[np.bool_]
    """[H, W], true except in the background."""
    rungs: dict[int, Pixels]
    """[h, w, 3] decoded frames, by rung."""


@dataclass(frozen=True, slots=True)
class ScenePairs:
    """Pairs of a scene at some rungs of its ladder. Methods raise as those of Renderer, and NoTrainingData."""

    renderer: Renderer
    scene: SceneInfo
    ladder: Sequence[Rung]
    rungs: Sequence[int]

    def training(self, number: int, until: float) -> list[Pair]:
        """Up to `number` views, or as many as can be rendered until a time on the monotonic clock."""
        return self._collect(islice(training_views(self.scene), POSES_PER_VIEW * number), number, until)

    def held_out(self, number: int) -> list[Pair]:
        """Views that are never used for training."""
        return self._collect(held_out_views(self.scene, POSES_PER_VIEW * number), number, float("inf"))

    def _collect(self, poses: Iterable[Pose], number: int, until: float) -> list[Pair]:
        found: list[Pair] = []
        for pair in self._render_pairs(iter(poses)):
            found.append(pair)
            if len(found) >= number or (len(found) >= MIN_VIEWS and time.monotonic() > until):
                break
        if not found:
            raise NoTrainingData("All views of the scene are empty.")
        return found

    def _render_pairs(self, poses: Iterator[Pose]) -> Iterator[Pair]:
        """The views that are not empty, in order."""
        pool = ThreadPoolExecutor(WORKERS)

        def submit(number: int) -> list[Future[Pair | None]]:
            return [pool.submit(self._render_pair, pose) for pose in islice(poses, number)]

        try:
            running = deque(submit(WORKERS))
            while running:
                pair = running.popleft().result()
                running.extend(submit(1))
                if pair is not None:
                    yield pair
        finally:
            pool.shutdown(cancel_futures=True)

    def _render_pair(self, pose: Pose) -> Pair | None:
        """A view at the best rung's size with its frames; None if it is nearly empty."""
        scene, lens = self.scene, intrinsics(self.ladder[0].width, self.ladder[0].height)
        full = self.renderer.picture(RenderRequest.at(scene.id, pose, lens, format="png"))
        background = np.round(np.array(scene.background) * 255).astype(np.int16)
        content = (np.abs(full.astype(np.int16) - background) > 1).any(axis=2)
        if content.mean() < MIN_CONTENT:
            return None
        picture = self.renderer.picture
        frames = {rung: picture(RenderRequest.at(scene.id, pose, lens, profile=rung)) for rung in self.rungs}
        return Pair(full, content, frames)


def held_out_views(scene: SceneInfo, number: int) -> list[Pose]:
    """Views of a scene that are never used for training; the same ones each time. Raises StartError."""
    return list(islice(_views(_axes(scene), Random(f"held out {scene.id}")), number))


def training_views(scene: SceneInfo) -> Iterator[Pose]:
    """Endless views, none of which is a neighbour of a held-out one. Raises StartError."""
    axes = _axes(scene)
    held_out = held_out_views(scene, MAX_HELD_OUT)
    for pose in _views(axes, Random(f"training {scene.id} 0")):
        if not any(axes.are_neighbours(pose, other) for other in held_out):
            yield pose


def _views(axes: SceneAxes, rng: Random) -> Iterator[Pose]:
    for number in count():
        yield from sample_movement(axes.orbit(rng) if number % 2 else axes.walk(rng), rng)


def _axes(scene: SceneInfo) -> SceneAxes:
    if scene.camera is None:
        raise StartError(f"The scene {scene.id} has no start camera.")
    return SceneAxes.from_camera(scene.camera, scene.up)
