"""Cameras of training and test views: on movements around a scene's start camera and its subject.

Held-out views are on separate movements, and no training view is next to one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from random import Random

from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.sample_cameras import SceneAxes, along
from tigas_common.wire.render import SceneInfo


def held_out_views(scene: SceneInfo, number: int) -> list[Pose]:
    """The views of a scene that no training sees; the same ones for the same scene. Raises StartError."""
    views = _views(_axes(scene), Random(f"held out {scene.id}"))
    return [next(views) for _ in range(number)]


def training_views(scene: SceneInfo, seed: int = 0) -> Iterator[Pose]:
    """Views without end, none of them a neighbour of a held-out one. Raises StartError."""
    axes = _axes(scene)
    held_out = held_out_views(scene, MOST_HELD_OUT)
    for pose in _views(axes, Random(f"training {scene.id} {seed}")):
        if not any(axes.are_neighbours(pose, other) for other in held_out):
            yield pose


MOST_HELD_OUT = 96
"""Views that may be asked for to test."""


def _views(axes: SceneAxes, chance: Random) -> Iterator[Pose]:
    for number in count():
        yield from along(axes.orbit(chance) if number % 2 else axes.walk(chance), chance)


def _axes(scene: SceneInfo) -> SceneAxes:
    if scene.camera is None:
        raise StartError(f"The scene {scene.id} has no start camera.")
    return SceneAxes.of(scene.camera, scene.up)
