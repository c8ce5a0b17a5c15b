"""Sizes and errors of a scene's views at each resolution and JPEG quality.

A frame is rendered as for the display, encoded, decoded, and enlarged with the page's bicubic filter.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice, product
from random import Random

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.resources import usable_processors
from tigas_common.sample_cameras import VIEWS_PER_MOVEMENT, SceneAxes, intrinsics, sample_movement
from tigas_render.encode.images import encode_jpeg
from tigas_render.raster.base import Camera, PreparedScene, Rasterizer
from tigas_render.scenes.scene_file import Listener

DISPLAY = (1280, 720)
"""Size in pixels of the image that a viewer sees."""
SIZES = tuple((32 * step, 18 * step) for step in (40, 35, 30, 26, 23, 20, 17, 15, 13, 11, 9, 8))
"""Widths and heights of frames in pixels, all 16:9 and even."""
QUALITIES = tuple(range(10, 95, 5))
"""JPEG qualities: above 90, frames grow by half for an invisible gain."""
POSES_PER_WALK = 3
MAX_TRIES = 4
"""Maximum number of poses to try for each non-empty view."""
MIN_CONTENT = 0.04
"""Minimum share of a view's pixels that show something other than the background."""

Pixels = NDArray[np.uint8]
Setting = tuple[int, int, int]
"""Width and height of a frame in pixels, and its JPEG quality."""
CANDIDATES: tuple[Setting, ...] = tuple((*size, quality) for size, quality in product(SIZES, QUALITIES))


@dataclass(frozen=True, slots=True)
class Point:
    """The result of a setting, averaged over all views."""

    width: int
    height: int
    quality: int
    kb: float
    """Mean size of a frame, in kilobytes (1000 bytes)."""
    mse: float
    """Mean squared error at display size, of values from 0 to 255."""

    @property
    def name(self) -> str:
        """Name of the setting, such as `640×360 q50`."""
        return f"{self.width}×{self.height} q{self.quality}"

    @property
    def psnr_db(self) -> float:
        return 10 * math.log10(255**2 / max(self.mse, 1e-6))


def random_walks(axes: SceneAxes, seed: str) -> Iterator[Pose]:
    """An endless sequence of poses of people walking around the start camera, determined by the seed."""
    chance = Random(seed)
    while True:
        yield from sample_movement(axes.walk(chance), chance)[:: VIEWS_PER_MOVEMENT // POSES_PER_WALK]


def measure_views(
    rasterizer: Rasterizer,
    scene: PreparedScene,
    background: tuple[float, float, float],
    poses: Iterable[Pose],
    settings: Sequence[Setting],
    listener: Listener,
    views: int,
) -> list[Point]:
    """Measure each setting on up to `views` non-empty views from `poses`. Raises StartError if all are empty."""
    totals = np.zeros((len(settings), 2))
    sizes = sorted({setting[:2] for setting in settings}, reverse=True)
    number = 0

    def rendered(pose: Pose, size: tuple[int, int]) -> Pixels:
        """Render a view like the service does for the display."""
        enlarged = math.sqrt(DISPLAY[0] * DISPLAY[1] / (size[0] * size[1]))
        lens = intrinsics(*DISPLAY).resized(*size)
        camera = Camera(pose, lens, background, max(1.0, enlarged), full_detail=True)
        with rasterizer.render(scene, camera, "png") as image:
            return image.to_host().copy()

    with ThreadPoolExecutor(usable_processors()) as pool:
        for pose in islice(poses, views * MAX_TRIES):
            truth = rendered(pose, DISPLAY)
            if not _shows_something(truth, background):
                continue
            exact = truth.astype(np.float32)
            frames = {size: rendered(pose, size) for size in sizes}
            outcomes = [pool.submit(_size_and_error, frames[setting[:2]], setting[2], exact) for setting in settings]
            for done, outcome in enumerate(outcomes, 1):
                totals[done - 1] += outcome.result()
                listener((number + done / len(settings)) / views)
            number += 1
            if number == views:
                break
    if number == 0:
        raise StartError("All views near the scene's start camera are empty.")
    return [
        Point(*setting, kb=float(size) / 1000, mse=float(error))
        for setting, (size, error) in zip(settings, totals / number, strict=True)
    ]


def _shows_something(picture: Pixels, background: tuple[float, float, float]) -> bool:
    empty = np.round(np.array(background) * 255).astype(np.int16)
    return float((np.abs(picture.astype(np.int16) - empty) > 1).any(axis=2).mean()) >= MIN_CONTENT


def _size_and_error(frame: Pixels, quality: int, truth: NDArray[np.float32]) -> tuple[float, float]:
    """The size in bytes, and the mean squared error at display size."""
    body = encode_jpeg(frame, quality)
    with Image.open(io.BytesIO(body)) as opened:
        shown = opened.convert("RGB").resize(DISPLAY, Image.Resampling.BICUBIC)
    error = (np.asarray(shown, np.float32) - truth).ravel()
    return len(body), float(error @ error) / error.size
