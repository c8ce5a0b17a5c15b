"""Frames made in lanes on a GPU equal separate ones."""

from __future__ import annotations

import io
import itertools
import select
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image as PillowImage

from tests.prerequisites import GPU
from tests.render.raster.cuda.exact_depth import exact_depth
from tests.render.raster.views import camera, cloud
from tigas_common.pose import Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import quantised
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.lanes import FetchedImage, Lanes

if TYPE_CHECKING:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

pytestmark = GPU.mark
FORMATS: tuple[FrameFormat, ...] = ("jpeg", "png", "yuv420p")


@pytest.fixture(scope="module")
def rasterizer(tmp_path_factory: pytest.TempPathFactory) -> CudaRasterizer:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    return CudaRasterizer(0, tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def lanes(rasterizer: CudaRasterizer) -> Iterator[Lanes]:
    lanes = Lanes(rasterizer.frames_in_flight, rasterizer.enter_thread)
    yield lanes
    lanes.end()
    lanes.close()


View = tuple[PreparedScene, Camera, FrameFormat]


def made(rasterizer: CudaRasterizer, lanes: Lanes, views: list[View], *, depth: bool = False) -> list[FetchedImage]:
    """The images of some views, as many at a time as there are lanes."""
    images: dict[int, FetchedImage | Exception] = {}
    for number, (scene, view, format) in enumerate(views):
        while not lanes.free:
            select.select([lanes], [], [])
            lanes.collect()
        lanes.begin(
            rasterizer.job(scene, view, format, 80, depth=depth),
            lambda image, number=number: images.update({number: image}),  # type: ignore[misc]
        )
    while len(images) < len(views):
        select.select([lanes], [], [])
        lanes.collect()
    return [image for _, image in sorted(images.items()) if isinstance(image, FetchedImage)]


@pytest.mark.parametrize(("width", "height"), [(640, 360), (641, 359), (1, 1)])
def test_a_lanes_frame_is_the_same_in_every_format(
    rasterizer: CudaRasterizer, lanes: Lanes, width: int, height: int
) -> None:
    scene, view = rasterizer.prepare(cloud(3_000, 1, size=0.15)), camera(width, height)
    images = made(rasterizer, lanes, [(scene, view, format) for format in FORMATS], depth=True)
    for format, image in zip(FORMATS, images, strict=True):
        assert image.content == rasterizer.render(scene, view, format, quality=80).content
        assert image.rendering > 0
        assert image.encoding > 0


def test_views_in_flight_do_not_mix_and_each_has_its_depth(rasterizer: CudaRasterizer, lanes: Lanes) -> None:
    scenes = [rasterizer.prepare(cloud(5_000, 0, seed, size=0.15)) for seed in range(4)]
    poses = [Pose.from_euler(10 * turn, 0, 0, (0.0, 0.0, -4.0)) for turn in range(5)]
    formats: tuple[FrameFormat, ...] = ("jpeg", "jpeg", "yuv420p")
    views: list[View] = [
        (scene, camera(640, 400, pose), format) for scene, pose, format in itertools.product(scenes, poses, formats)
    ]
    alone = [made(rasterizer, lanes, [view], depth=True)[0] for view in views]
    together = made(rasterizer, lanes, views * 5, depth=True)
    assert [image.content for image in together] == [image.content for image in alone] * 5
    assert [image.coded_depth for image in together] == [image.coded_depth for image in alone] * 5


@pytest.mark.parametrize("place", [(0.0, 0.0, -4.0), (0.3, -0.2, -1.0)], ids=["outside", "among"])
@pytest.mark.parametrize(("width", "height"), [(64, 48), (37, 41), (400, 20), (640, 360), (1921, 1081)])
def test_a_coded_depth_is_as_the_host_would_code_it(
    rasterizer: CudaRasterizer, lanes: Lanes, place: tuple[float, float, float], width: int, height: int
) -> None:
    scene = rasterizer.prepare(cloud(3_000, 1, size=0.15))
    view = camera(width, height, Pose.from_euler(20, 10, 30, place))
    (image,) = made(rasterizer, lanes, [(scene, view, "jpeg")], depth=True)
    nearest, codes = quantised(exact_depth(rasterizer.job(scene, view, "jpeg", 80, depth=True)))
    assert image.coded_depth is not None
    assert image.coded_depth.nearest == pytest.approx(nearest, rel=5e-4)
    decoded = np.asarray(PillowImage.open(io.BytesIO(image.coded_depth.image)))
    assert decoded.shape == codes.shape
    as_the_host = io.BytesIO()
    PillowImage.fromarray(codes).save(as_the_host, "JPEG", quality=28)
    expected = np.asarray(PillowImage.open(as_the_host))
    assert np.sqrt(np.mean((decoded.astype(float) - expected) ** 2)) < 1


def test_a_depth_of_nothing_is_black(rasterizer: CudaRasterizer, lanes: Lanes) -> None:
    nothing = Gaussians(*(array[:0] for array in cloud(1, 0).arrays))
    (image,) = made(rasterizer, lanes, [(rasterizer.prepare(nothing), camera(320, 200), "jpeg")], depth=True)
    assert image.coded_depth is not None
    assert image.coded_depth.nearest == 0
    assert not np.asarray(PillowImage.open(io.BytesIO(image.coded_depth.image))).any()
