"""A large scene is drawn at the level of detail that the picture's pixels can show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.render.raster.views import STRANGE, cloud, fives, from_afar, pixels, psnr, with_others_among_them
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer, levels, scene
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu import rasterizer as rasterizer_module
from tigas_render.raster.cpu.scene import CpuScene
from tigas_render.scenes.entry import LoadingEnded

COUNT = 60_000


@pytest.fixture(autouse=True)
def every_scene_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that tests need no million Gaussians."""
    for module in (levels, scene):
        monkeypatch.setattr(module, "FROM", 0)


@pytest.fixture(scope="module")
def rasterizer() -> CpuRasterizer:
    return CpuRasterizer()


def chunks_drawn(rasterizer: CpuRasterizer, packed: CpuScene, view: Camera) -> int:
    job = rasterizer.start(packed, view)
    job.image.close()
    return len(job.chosen)


def colours_of(packed: CpuScene, first: int, end: int) -> NDArray[np.float16]:
    """[N, 3] the first coefficients of some chunks' Gaussians."""
    groups = L.CHUNK // L.LANES
    return packed.sh[first * groups : end * groups].transpose(0, 2, 1).reshape(-1, packed.sh.shape[1])[:, :3]


@pytest.mark.slow
def test_near_by_all_of_a_scene_is_drawn(rasterizer: CpuRasterizer) -> None:
    packed = rasterizer.pack(cloud(COUNT, 1, size=0.02).batches())
    view = from_afar(2.0)
    np.testing.assert_array_equal(
        pixels(rasterizer.render(packed, view)), pixels(rasterizer.render(packed, replace(view, full_detail=True)))
    )


def test_from_afar_fewer_gaussians_make_nearly_the_same_picture(rasterizer: CpuRasterizer) -> None:
    packed = rasterizer.pack(cloud(COUNT, 2, size=0.02).batches())
    everything = COUNT / L.CHUNK
    for distance, share in ((200.0, 0.35), (600.0, 0.1)):
        view = from_afar(distance)
        assert chunks_drawn(rasterizer, packed, view) < share * everything
        full = pixels(rasterizer.render(packed, replace(view, full_detail=True)))
        assert full.max() > 20
        assert psnr(pixels(rasterizer.render(packed, view)), full) > 35


def test_making_levels_can_be_ended(rasterizer: CpuRasterizer) -> None:
    calls = iter(range(3))

    def check() -> None:
        if next(calls) == 2:
            raise LoadingEnded("The service is stopping.")

    with pytest.raises(LoadingEnded):
        rasterizer.pack(replace(cloud(COUNT, 1).batches(), check=check))


def test_levels_take_a_third_more_memory_at_most(rasterizer: CpuRasterizer, monkeypatch: pytest.MonkeyPatch) -> None:
    with_levels = rasterizer.pack(cloud(COUNT, 3, size=0.02).batches())
    for module in (levels, scene):
        monkeypatch.setattr(module, "FROM", COUNT + 1)
    without = rasterizer.pack(cloud(COUNT, 3, size=0.02).batches())
    assert 1.2 < with_levels.nbytes / without.nbytes < 1.34


@pytest.mark.parametrize("change", ["large", "far away"])
def test_what_is_larger_than_a_cell_or_far_outside_is_never_merged(rasterizer: CpuRasterizer, change: str) -> None:
    packed = rasterizer.pack(with_others_among_them(COUNT, 1000, change).batches())
    coarsest = [levels_of_node[levels_of_node[:, 1] > 0][-1] for levels_of_node in packed.nodes.chunks]
    colours = np.concatenate([colours_of(packed, first, end) for first, end in coarsest])
    kept = (np.abs(colours / packed.sh.max() - 1) < 1e-3).all(axis=1).sum()
    assert kept >= 0.9 * (COUNT / 1000)


@pytest.mark.parametrize("strange", STRANGE)
def test_strange_scenes_have_levels_that_can_be_drawn(rasterizer: CpuRasterizer, strange: str) -> None:
    everything = cloud(20_000, 0)
    STRANGE[strange](everything)
    packed = rasterizer.pack(everything.batches())
    for distance in (3.0, 1000.0):
        rasterizer.render(packed, from_afar(distance)).close()


def test_where_there_is_still_too_much_details_are_left_out(
    rasterizer: CpuRasterizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed, view = rasterizer.pack(cloud(COUNT, 0, size=0.005).batches()), from_afar(100.0)
    usual = chunks_drawn(rasterizer, packed, view)
    monkeypatch.setattr(rasterizer_module, "MOST_CHUNKS", usual // 2)
    assert chunks_drawn(rasterizer, packed, view) <= usual // 2
    monkeypatch.setattr(rasterizer_module, "MOST_CHUNKS", 1)
    fewest = chunks_drawn(rasterizer, packed, view)
    assert 1 < fewest < usual
    exact = rasterizer.start(packed, view, 0.0)
    exact.image.close()
    assert len(exact.chosen) >= usual


def test_what_becomes_one_keeps_its_place_size_colour_and_cover(rasterizer: CpuRasterizer) -> None:
    """Groups of five neighbours, far from others; a few are cut by a cell's border."""
    places, step, size = np.random.default_rng(1).uniform(0, 10, (4000, 3)), 0.001, 0.0004
    packed = rasterizer.pack(fives(places, step, size).batches())
    first, end = packed.nodes.chunks[2, 1]
    merged = packed.geometry[first:end].transpose(0, 2, 1).reshape(-1, L.GEOMETRY)
    shown = merged[:, L.LOG_ALPHA] > -2
    mean = np.median(merged[shown], axis=0)
    np.testing.assert_allclose(mean[L.COV_XX], 2 * step**2 + size**2, rtol=1e-2)
    np.testing.assert_allclose(mean[L.COV_YY], size**2, rtol=1e-2)
    np.testing.assert_allclose(2 ** (mean[L.LOG_ALPHA] / L.ALPHA_SCALE), 1 - 0.9**5, rtol=1e-2)
    colours = colours_of(packed, first, end)[shown].astype(float)
    np.testing.assert_allclose(np.median(colours[:, 0]) / np.median(colours[:, 1]), 0.25, rtol=1e-2)
    distances = np.abs(merged[shown][:, None, :3] - places[None]).max(axis=2).min(axis=1)
    assert np.median(distances) < 1e-5
