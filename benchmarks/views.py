"""Where benchmarks look at scenes from: a camera's file, or where a visitor would start."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tigas_common.pose import Intrinsics, Pose, Vector3
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.source import SceneMetadata
from tigas_render.scenes.start_view.statistics import SceneStatistics

View = dict[str, list[float]]
"""`position`, `look_at` and `up`, as in a file of cameras."""


def centred_lens(width: int, height: int) -> Intrinsics:
    """A vertical field of view of 60 degrees."""
    focal = height / 2 / math.tan(math.radians(30))
    return Intrinsics(focal, focal, width / 2, height / 2, width, height)


def start_view(gaussians: Gaussians, *, builtin: bool) -> View:
    """Where a visitor of a scene would start; `builtin`: of the demo scene."""
    view = SceneStatistics.of(gaussians).view(DEMO_SOURCE.metadata if builtin else SceneMetadata())
    return {"position": list(view.camera.position), "look_at": list(view.camera.look_at), "up": list(view.up)}


def look(view: View, turned: float = 0.0) -> Pose:
    """The pose of a view, after a turn by an angle in degrees around its focus."""
    position, target, up = (np.array(view[name], float) for name in ("position", "look_at", "up"))
    up /= np.linalg.norm(up)
    arm, angle = position - target, math.radians(turned)  # Rodrigues' rotation
    arm = arm * math.cos(angle) + np.cross(up, arm) * math.sin(angle) + up * (up @ arm) * (1 - math.cos(angle))
    return Pose.look_at(_vector(target + arm), _vector(target), _vector(up))


def chosen(scenes: list[str] | None, cameras: Path | None) -> Iterator[tuple[str, Gaussians, View]]:
    """Name, Gaussians and view of each NAME=PLY; of the demo scene, if there is none or no PLY.

    cameras: JSON with a view for each name; a scene without one is seen from where a visitor would start.
    """
    views = json.loads(cameras.read_text()) if cameras else {}
    for argument in scenes or ["courtyard="]:
        name, _, path = argument.partition("=")
        gaussians = read_scene_file(Path(path)).load() if path else DEMO_SOURCE.load()
        yield name, gaussians, views.get(name) or start_view(gaussians, builtin=not path)


def _vector(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z
