"""The up axis: found in scenes that are tilted or have z up, and kept as the file has it where nothing shows it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from tests.render.scenes.start_view import captures
from tests.render.scenes.start_view.captures import Array
from tests.shared_data import reference_scene_ply
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.scenes.start_view.view import derive_view

SCENES = [captures.room, captures.square, captures.field, captures.statue]
TILTS = [((1, 0, 0), 0), ((1, 0, 0.3), 10), ((0.3, 0, -1), 15), ((-1, 0.2, 0.5), 20), ((0.2, 0.1, 1), 25)]


@functools.cache
def captured(name: str) -> Gaussians:
    """Every third Gaussian of a captured scene."""
    scene = read_scene_file(reference_scene_ply(name)).load()
    return Gaussians(*(np.ascontiguousarray(array[::3]) for array in scene.arrays))


def error(scene: Gaussians, true: Array) -> float:
    """Degrees between the derived and the true up axis."""
    sample = SceneStatistics.of(scene).sample
    up = np.array(derive_view(sample, share=len(sample) / len(scene)).up)
    assert np.linalg.norm(up) == pytest.approx(1)
    return math.degrees(math.acos(min(1.0, float(up @ true))))


@pytest.mark.parametrize(("axis", "degrees"), TILTS)
@pytest.mark.parametrize("scene", SCENES)
def test_a_tilted_scene_is_levelled(scene: Callable[[], Gaussians], axis: Sequence[float], degrees: float) -> None:
    assert error(*captures.turned(scene(), axis, degrees)) < 3


@pytest.mark.parametrize("scene", [captures.square, captures.field, captures.statue])
def test_a_file_with_z_up_is_recognised(scene: Callable[[], Gaussians]) -> None:
    turned, up = captures.turned(scene(), (1, 0, 0), -90)
    assert up @ (0, 0, 1) == pytest.approx(1)
    assert error(turned, up) < 3


def test_a_nearly_level_scene_keeps_its_files_axis_exactly() -> None:
    scene, _ = captures.turned(captures.room(), (1, 0, 1), 2)
    assert derive_view(scene).up == (0, -1, 0)


def test_an_object_that_shows_no_ground_keeps_its_files_axis() -> None:
    slab = captures.discs(captures.box((-0.1, -2, -0.8), (0.1, 0, 0.8)), 40, 0.02)  # stands on its edge
    assert derive_view(slab).up == (0, -1, 0)


@pytest.mark.parametrize("name", ["guitar", "flowers", "narcissus", "playbot"])
def test_captured_scenes_keep_their_axis(name: str) -> None:
    assert error(captured(name), np.array([0, -1, 0])) < 10


@pytest.mark.parametrize(("axis", "degrees"), TILTS[4:])
@pytest.mark.parametrize("name", ["flowers", "narcissus", "playbot"])
def test_tilted_captured_scenes_are_levelled(name: str, axis: Sequence[float], degrees: float) -> None:
    assert error(*captures.turned(captured(name), axis, degrees)) < 10
