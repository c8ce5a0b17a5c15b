"""Guarantees of the CPU rasteriser: the background, the framebuffers, memory, and equal frames."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.render.raster.views import balls, camera, cloud, pixels
from tigas_common.pose import Pose
from tigas_render.raster.cpu import CpuRasterizer


def test_the_background_shows_where_nothing_is() -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(balls((0.0, 0.0, 0.0), size=0.1, opacity=0.5, colours=[[1.0, 0.0, 0.0]]))
    picture = pixels(rasterizer.render(scene, camera(101, 51, background=(0.2, 0.4, 1.0))))
    assert tuple(picture[0, 0]) == (51, 102, 255)
    np.testing.assert_allclose(picture[25, 50], [0.5 * 255 + 25.5, 51, 127.5], atol=2)


def test_frames_are_equal_whatever_the_threads_do() -> None:
    rasterizer = CpuRasterizer()
    scene, view = rasterizer.prepare(cloud(20_000, 2)), camera(320, 180)
    first = pixels(rasterizer.render(scene, view))
    assert first.any()
    for _ in range(5):
        np.testing.assert_array_equal(pixels(rasterizer.render(scene, view)), first)


def test_an_open_image_keeps_its_pixels_while_the_next_is_rendered() -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(cloud(500, 0))
    with rasterizer.render(scene, camera(64, 64, background=(1.0, 0.0, 0.0))) as first:
        before = first.to_host().copy()
        with rasterizer.render(scene, camera(64, 64, background=(0.0, 1.0, 0.0))) as second:
            assert not np.shares_memory(first.to_host(), second.to_host())
            assert (first.to_host() == before).all()
            assert (second.to_host() != before).any()


def test_a_closed_image_gives_its_framebuffer_back_once() -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(cloud(500, 0))
    image = rasterizer.render(scene, camera(64, 64))
    memory = image.to_host()
    image.close()
    image.close()
    with pytest.raises(ValueError, match="closed"):
        image.encode("jpeg", 90)
    first, second = rasterizer.render(scene, camera(32, 64)), rasterizer.render(scene, camera(64, 32))
    assert np.shares_memory(memory, first.to_host())
    assert not np.shares_memory(first.to_host(), second.to_host())


def test_an_image_encodes_itself() -> None:
    rasterizer = CpuRasterizer()
    with rasterizer.render(rasterizer.prepare(cloud(500, 0)), camera(64, 48)) as image:
        assert (image.width, image.height) == (64, 48)
        assert image.encode("jpeg", 80).startswith(b"\xff\xd8")
        assert image.encode("png", 0).startswith(b"\x89PNG")
        assert len(image.encode("yuv420p", 0)) == 64 * 48 * 3 // 2


def test_frames_after_the_first_allocate_nothing_that_grows() -> None:
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(cloud(20_000, 1))
    views = [
        camera(w, h, Pose.from_euler(a, 0, 0, (0.0, 0.0, -3.0))) for a in (0, 20) for w, h in ((320, 180), (64, 99))
    ]

    def frames() -> None:
        for view in views:
            rasterizer.render(scene, view).close()

    frames()
    tracemalloc.start()
    try:
        frames()
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        frames()
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 2_000
    assert peak - before < 20_000


def test_a_prepared_scene_tells_its_size_and_leaves_out_what_is_invisible() -> None:
    rasterizer = CpuRasterizer()
    gaussians = cloud(1024, 3)
    visible, hidden = (replace(gaussians, opacities=np.full(1024, each, np.float32)) for each in (0.5, 0.003))
    assert rasterizer.prepare(visible).nbytes >= 1024 * (10 * 4 + 48 * 2)
    assert rasterizer.prepare(hidden).nbytes == 0


def test_a_frame_may_be_rendered_while_another_pauses() -> None:
    rasterizer = CpuRasterizer()
    large, small = (rasterizer.prepare(cloud(20_000, 2, seed)) for seed in (1, 2))
    alone = [pixels(rasterizer.render(large, camera(1280, 720))), pixels(rasterizer.render(small, camera(320, 180)))]
    meanwhile = []

    def pause() -> None:
        meanwhile.append(pixels(rasterizer.render(small, camera(320, 180))))

    interrupted = pixels(rasterizer.render(large, camera(1280, 720), pause=pause))
    np.testing.assert_array_equal(interrupted, alone[0])
    assert len(meanwhile) > 1
    for picture in meanwhile:
        np.testing.assert_array_equal(picture, alone[1])
