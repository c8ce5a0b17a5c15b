"""The built-in scene: the very file that it is known as, whole, and pleasant to stand in."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from tigas_common.pose import Pose
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, PreparedScene, Rasterizer
from tigas_render.raster.devices import create_rasterizer
from tigas_render.raster.host_image import HostImage
from tigas_render.scenes.demo import DEMO_SOURCE
from tigas_render.server.preview import preview_camera

SHA256 = "57659121169acb77cc344d37ca7825095773cbdfc89759e356124bc38f1382a8"
EYE = -1.65
CAMERA, UP = DEMO_SOURCE.metadata.camera, DEMO_SOURCE.metadata.up


@pytest.fixture(scope="module")
def scene() -> Gaussians:
    return DEMO_SOURCE.load()


@pytest.fixture(scope="module")
def rasterizer() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.fixture(scope="module")
def prepared(scene: Gaussians, rasterizer: Rasterizer) -> PreparedScene:
    return rasterizer.prepare(scene)


def pixels(rasterizer: Rasterizer, prepared: PreparedScene, camera: Camera) -> NDArray[np.int16]:
    with rasterizer.render(prepared, camera) as image:
        assert isinstance(image, HostImage)
        return np.array(image.pixels, np.int16)


def test_it_is_the_courtyard_that_results_speak_of() -> None:
    assert DEMO_SOURCE.digest is not None
    assert DEMO_SOURCE.digest() == SHA256, "another scene needs another id: results name this one"
    assert (DEMO_SOURCE.id, DEMO_SOURCE.name, DEMO_SOURCE.format) == ("courtyard", "Courtyard", "SOG")


def test_it_is_sound_and_of_the_promised_size(scene: Gaussians) -> None:
    assert len(scene) == DEMO_SOURCE.gaussians == 298_886
    assert scene.sh_degree == DEMO_SOURCE.sh_degree == 1
    for array in scene.arrays:
        assert array.dtype == np.float32
        assert array.flags.c_contiguous
        assert np.isfinite(array).all()
    assert scene.scales.min() > 0
    assert 0 < scene.opacities.min() <= scene.opacities.max() <= 1
    np.testing.assert_allclose(np.linalg.norm(scene.quaternions, axis=1), 1, rtol=1e-6)


def test_highlights_move_with_the_viewer(scene: Gaussians) -> None:
    change = np.sqrt((scene.sh[:, 1:] ** 2).sum((1, 2)))
    assert (change > 0.02).mean() > 0.1


@pytest.mark.parametrize(
    "place",
    [(-0.9, EYE, -9.7), (0.0, EYE, 8.0), (-5.0, EYE, 0.0), (9.9, EYE, 0.0), (9.9, EYE, 12.3), (0.0, EYE, -12.3)],
)
def test_nothing_shines_through_in_any_direction(
    rasterizer: Rasterizer, prepared: PreparedScene, place: tuple[float, float, float]
) -> None:
    assert CAMERA is not None
    camera = preview_camera(CAMERA, UP, 160, 90)
    for azimuth, elevation in ((0, 0), (90, 0), (180, 0), (270, 0), (45, 60), (225, 60), (0, -40), (180, -40)):
        view = replace(camera, pose=Pose.from_euler(azimuth, elevation, 0, place))
        black = pixels(rasterizer, prepared, replace(view, background=(0, 0, 0)))
        white = pixels(rasterizer, prepared, replace(view, background=(1, 1, 1)))
        share_of_background = (white - black).max(axis=2) / 255
        assert np.quantile(share_of_background, 0.999) < 0.1, (azimuth, elevation)
        assert share_of_background.mean() < 0.01, (azimuth, elevation)


def test_the_first_view_is_bright_colourful_and_detailed(rasterizer: Rasterizer, prepared: PreparedScene) -> None:
    assert CAMERA is not None
    picture = pixels(rasterizer, prepared, preview_camera(CAMERA, UP, 640, 360))
    assert 90 < picture.mean() < 200
    assert (picture.max(axis=2) - picture.min(axis=2)).mean() > 25
    assert (picture.min(axis=2) > 250).mean() < 0.03  # hardly anything is burnt out
    assert np.abs(np.diff(picture.sum(axis=2), axis=1)).mean() > 6


def test_it_comes_with_a_ladder_of_its_own_without_jumps() -> None:
    ladder = DEMO_SOURCE.ladder
    assert ladder is not None
    assert len(ladder) >= 8
    for better, worse in pairwise(ladder):
        assert 1.2 < better.expected_kb / worse.expected_kb < 2
        assert 1 < (better.psnr_db or 0) - (worse.psnr_db or 0) < 3
        assert worse.width * worse.height <= better.width * better.height


def test_a_visitor_enters_at_eye_height() -> None:
    assert CAMERA is not None
    assert -2 < CAMERA.position[1] < -1.5
    assert math.dist(CAMERA.position, CAMERA.look_at) > 1
