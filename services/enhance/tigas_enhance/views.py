"""Where cameras stand to train and to test: on movements about a scene's start camera and around what it looks at.

Held-out views lie on movements of their own, and no training view is a neighbour of one of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from random import Random

from tigas_common.errors import StartError
from tigas_common.pose import Pose
from tigas_common.standpoints import Place, along
from tigas_common.wire.render import SceneInfo


def held_out_views(scene: SceneInfo, number: int) -> list[Pose]:
    """The views of a scene that no training sees; the same ones for the same scene. Raises StartError."""
    views = _views(_place(scene), Random(f"held out {scene.id}"))
    return [next(views) for _ in range(number)]


def training_views(scene: SceneInfo, seed: int = 0) -> Iterator[Pose]:
    """Views without end, none of them a neighbour of a held-out one. Raises StartError."""
    place = _place(scene)
    held_out = held_out_views(scene, MOST_HELD_OUT)
    for pose in _views(place, Random(f"training {scene.id} {seed}")):
        if not any(place.are_neighbours(pose, other) for other in held_out):
            yield pose


MOST_HELD_OUT = 96
"""Views that may be asked for to test."""


def _views(place: Place, chance: Random) -> Iterator[Pose]:
    for number in count():
        yield from along(place.orbit(chance) if number % 2 else place.walk(chance), chance)


def _place(scene: SceneInfo) -> Place:
    if scene.camera is None:
        raise StartError(f"The scene {scene.id} has no start camera.")
    return Place.of(scene.camera, scene.up)
