"""A large scene has coarser levels, and is drawn at the one that the picture's pixels can show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from tests.prerequisites import GPU
from tests.render.raster.views import STRANGE, cloud, fives, from_afar, psnr, with_others_among_them
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.cpu import layout as L
from tigas_render.raster.cpu import levels as cpu_levels
from tigas_render.raster.cpu.scene import describe
from tigas_render.raster.cuda import levels
from tigas_render.raster.cuda.levels import DEVIATION, EDGE, FAN_OUT, NEVER, PARENT
from tigas_render.raster.cuda.packing import pack
from tigas_render.raster.cuda.scene import CHUNK, CudaScene, Grid, opacities
from tigas_render.scenes.entry import LoadingEnded

if TYPE_CHECKING:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def every_scene_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that tests need no million Gaussians."""
    monkeypatch.setattr(levels, "FROM", 0)


def sorted_rows(gaussians: Gaussians) -> tuple[np.ndarray, np.ndarray, Grid, np.ndarray]:
    """As the CPU rasteriser has them: rows and colours in Z-order, their grid and codes."""
    grid = Grid.of(torch.from_numpy(gaussians.means))
    codes = grid.codes(torch.from_numpy(gaussians.means))
    order = torch.argsort(codes, stable=True).numpy()
    rows = np.empty((len(gaussians), L.GEOMETRY), np.float32)
    describe(order, *(np.ascontiguousarray(array) for array in gaussians.arrays[:4]), rows)
    halves = gaussians.sh[order].reshape(len(order), -1).astype(np.float16)
    return rows, halves, grid, codes.numpy()[order].astype(np.uint64)


@pytest.mark.parametrize("blur", [0.0, 0.01])
def test_merging_is_the_cpus(blur: float) -> None:
    rows, sh, grid, codes = sorted_rows(cloud(3000, 1, size=0.02))
    doublings = 17
    shift, edge = 3 * doublings, grid.cell * 2**doublings
    sizes = np.zeros(len(rows))  # none is too large
    into, colours = np.empty_like(rows), np.empty(sh.shape, np.float32)
    count = cpu_levels.merge(rows, sh.view(np.uint16), codes, sizes, shift, edge, blur, into, colours)

    lengths = torch.from_numpy(np.unique(codes >> np.uint64(shift), return_counts=True)[1])
    assert 100 < count == len(lengths) < 1500
    table = torch.from_numpy(rows).double()
    alpha = torch.exp2(table[:, L.LOG_ALPHA] / L.ALPHA_SCALE)
    means, covariances, opacity, weights = levels.merge(
        table[:, :3], table[:, L.COV_XX : L.LOG_ALPHA], alpha, lengths, torch.full((len(rows),), blur)
    )
    np.testing.assert_allclose(means, into[:count, :3], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(covariances, into[:count, L.COV_XX : L.LOG_ALPHA], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(opacity.log2() * L.ALPHA_SCALE, into[:count, L.LOG_ALPHA], rtol=1e-4, atol=1e-5)
    mixed = torch.segment_reduce(weights[:, None] * torch.from_numpy(sh).double(), "sum", lengths=lengths, axis=0)
    np.testing.assert_allclose(mixed, colours[:count], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("most", [64, 256, 1000])
def test_cells_are_as_small_as_the_cpus_or_halved_along_some_axes(most: int) -> None:
    rows, _, grid, codes = sorted_rows(cloud(3000, 0, size=0.02))
    sizes = np.empty(len(rows))
    cpu_levels.measure(rows, grid.low, grid.scale, 20, np.empty_like(codes), sizes)
    doublings = cpu_levels.cells_for(most, codes, sizes, grid.cell, 20)
    group, least = torch.zeros(len(rows), dtype=torch.int64), torch.zeros(1, dtype=torch.int64)
    found = levels.shifts_for(
        most, group, torch.from_numpy(codes.astype(np.int64)), torch.from_numpy(sizes), grid.cell, least
    )
    assert 3 * doublings - 2 <= int(found) <= 3 * doublings
    assert float(levels.edges(found, grid.cell)) == pytest.approx(grid.cell * 2**doublings)


def test_eigenvectors_and_quaternions_give_the_covariance_again() -> None:
    random = torch.Generator().manual_seed(1)
    axes = levels.rotations(torch.randn(1000, 4, generator=random).double())
    deviations = torch.rand(1000, 3, generator=random).double()
    deviations[::10, 0] = 0
    deviations[::7, 1] = deviations[::7, 2]
    original = axes * deviations[:, None].square() @ axes.transpose(1, 2)
    variances, columns = levels.eigen(original.reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]])
    turned = levels.rotations(levels.quaternions(columns))
    torch.testing.assert_close(turned * variances[:, None] @ turned.transpose(1, 2), original, rtol=0, atol=1e-12)


def generations(scene: CudaScene) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """Numbers of all chunks with a parent, and of their parents."""
    parents = scene.bounds.view(torch.int32)[:, PARENT].long()
    children = (parents >= 0).nonzero().squeeze(1)
    yield children, parents[children]


def shown(scene: CudaScene, chunk: int) -> torch.Tensor:
    """The slots of a chunk's Gaussians."""
    slots = torch.arange(chunk * CHUNK, (chunk + 1) * CHUNK)
    return slots[opacities(scene.shapes[slots]) > 0]


@pytest.mark.parametrize("count", [1, 256, 300, 5 * 256, 20_000])
def test_all_chunks_but_one_have_a_parent_that_holds_them(count: int) -> None:
    scene = pack(cloud(count, 0, size=0.02).batches(), CPU)
    bounds = scene.bounds.double()
    ((children, parents),) = generations(scene)
    assert len(children) == len(bounds) - 1
    assert (parents.bincount() <= FAN_OUT).all()
    gaps = (bounds[children, :3] - bounds[parents, :3]).norm(dim=1) + bounds[children, 3] - bounds[parents, 3]
    assert (gaps < 0).all()
    assert (bounds[children, EDGE] < bounds[parents, EDGE]).all()
    for chunk in range(len(bounds)):
        slots = shown(scene, chunk)
        assert 0 < len(slots) <= CHUNK
        assert ((scene.means[:, slots].T - bounds[chunk, :3]).norm(dim=1) <= bounds[chunk, 3] + 1e-6).all()
        assert float(scene.scale_codes.scales(scene.shapes[slots]).max()) <= bounds[chunk, DEVIATION]


def test_what_becomes_one_keeps_its_place_size_colour_and_cover() -> None:
    """Groups of five neighbours, far from others; a few are cut by a cell's border."""
    places, step, size = np.random.default_rng(1).uniform(0, 10, (512, 3)), 0.001, 0.0004
    scene = pack(fives(places, step, size).batches(), CPU)
    leaves = -(-5 * len(places) // CHUNK)
    slots = torch.cat([shown(scene, chunk) for chunk in range(leaves, leaves + -(-leaves // FAN_OUT))])
    shapes = scene.shapes[slots]
    scales = scene.scale_codes.scales(shapes).sort(dim=1).values.median(dim=0).values
    np.testing.assert_allclose(scales, [size, size, (2 * step**2 + size**2) ** 0.5], rtol=5e-3)
    np.testing.assert_allclose(opacities(shapes).median(), 1 - 0.9**5, rtol=3e-2)
    red, green = (scene.sh[0, slots, channel].double().median() for channel in (0, 1))
    np.testing.assert_allclose(red / green, 0.25, rtol=1e-2)
    distances = np.abs(scene.means[:, slots].T.numpy()[:, None] - places[None]).max(axis=2).min(axis=1)
    assert np.median(distances) < 1e-5


@pytest.mark.parametrize("change", ["large", "far away"])
def test_what_is_larger_than_a_cell_or_far_outside_is_not_merged(change: str) -> None:
    everything = with_others_among_them(5120, 200, change)
    everything.opacities[:] = 0.5
    scene = pack(everything.batches(), CPU)
    kept = (scene.sh[0, shown(scene, len(scene.bounds) - 1), 0].float() / scene.sh.max() - 1).abs() < 1e-3
    assert int(kept.sum()) == -(-5120 // 200)


def test_children_without_room_in_a_parent_are_drawn_from_everywhere() -> None:
    everything = cloud(1024, 0, size=0.02)
    everything.opacities[:] = 0.5
    everything.scales[:] = 1e6
    scene = pack(everything.batches(), CPU)
    assert scene.bounds[-1, EDGE] == NEVER
    assert not scene.shapes[4 * CHUNK :, 3].any()


def test_levels_take_a_third_more_memory_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = cloud(60_000, 3, size=0.02)
    with_levels = pack(scene.batches(), CPU)
    monkeypatch.setattr(levels, "FROM", 60_001)
    assert 1.3 < with_levels.nbytes / pack(scene.batches(), CPU).nbytes < 1.35


def test_a_scene_in_several_batches_is_that_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    first = pack(cloud(20_000, 1).batches(), CPU)
    monkeypatch.setattr(levels, "PARENTS_AT_ONCE", 3)
    second = pack(cloud(20_000, 1).batches(), CPU)
    for name in ("means", "shapes", "sh", "bounds"):
        assert torch.equal(getattr(first, name).nan_to_num(), getattr(second, name).nan_to_num())


def test_making_levels_can_be_ended() -> None:
    def check() -> None:
        raise LoadingEnded("The service is stopping.")

    with pytest.raises(LoadingEnded):
        pack(replace(cloud(1000, 1).batches(), check=check), CPU)


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("strange", STRANGE)
def test_strange_scenes_have_levels_of_finite_gaussians(strange: str, antialiased: bool) -> None:
    everything = replace(cloud(5000, 0), antialiased=antialiased)
    STRANGE[strange](everything)
    scene = pack(everything.batches(), CPU)
    for numbers in (scene.means, scene.sh, scene.bounds[:, :5]):
        assert numbers.isfinite().all()


# --- on a GPU ---


@pytest.fixture(scope="module")
def rasterizer(tmp_path_factory: pytest.TempPathFactory) -> CudaRasterizer:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    return CudaRasterizer(0, tmp_path_factory.mktemp("cache"))


def drawn(rasterizer: CudaRasterizer, scene: PreparedScene, view: Camera) -> tuple[np.ndarray, int]:
    """A picture, and how many entries its lists had."""
    picture = rasterizer.render(scene, view, "png").to_host()
    workspace = rasterizer.take_workspace()
    rasterizer.give_back(workspace)
    return picture, workspace.entries


@GPU.mark
@pytest.mark.parametrize(("distance", "share"), [(5.0, 1.0), (50.0, 1.0), (200.0, 0.8), (600.0, 0.2), (5000.0, 0.02)])
def test_from_afar_fewer_gaussians_make_nearly_the_same_picture(
    rasterizer: CudaRasterizer, distance: float, share: float
) -> None:
    scene, view = rasterizer.prepare(cloud(60_000, 2, size=0.02)), from_afar(distance)
    picture, entries = drawn(rasterizer, scene, view)
    full, all_entries = drawn(rasterizer, scene, replace(view, full_detail=True))
    assert full.max() > 20
    assert psnr(picture, full) > 40
    assert entries <= share * all_entries


@GPU.mark
def test_a_picture_in_full_detail_is_that_of_the_scene_without_levels(
    rasterizer: CudaRasterizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_levels = rasterizer.prepare(cloud(60_000, 1, size=0.02))
    monkeypatch.setattr(levels, "FROM", 60_001)
    without = rasterizer.prepare(cloud(60_000, 1, size=0.02))
    for distance in (1.0, 300.0):
        view = replace(from_afar(distance), full_detail=True)
        first, second = (rasterizer.render(scene, view, "png").to_host() for scene in (with_levels, without))
        assert psnr(first, second) > 60  # the steps that scales are rounded to differ a little


@GPU.mark
def test_equal_views_are_equal_bytes_on_every_occasion(rasterizer: CudaRasterizer) -> None:
    first, second = (rasterizer.prepare(cloud(60_000, 1, size=0.02)) for _ in range(2))
    contents = {
        rasterizer.render(scene, from_afar(distance), depth=True).content
        for scene in (first, second, first)
        for distance in (300.0,)
    }
    rasterizer.render(first, from_afar(1.0))
    assert contents == {rasterizer.render(first, from_afar(300.0), depth=True).content}
