"""What of the CUDA rasteriser needs no GPU: tiles, packing, parameters and the cache's keys."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

from tests.render.raster.views import camera, cloud
from tigas_common.pose import Intrinsics
from tigas_render.gaussians import Gaussians
from tigas_render.raster.cuda import compiler, layout, parameters
from tigas_render.raster.cuda.layout import tile_layout
from tigas_render.raster.cuda.scene import CHUNK, coefficients_in_use, morton_codes, pack

KERNELS = Path(layout.__file__).parent / "kernels"
SIZES = [(1, 1), (320, 180), (640, 360), (1280, 720), (1920, 1080), (3840, 2160), (8192, 2048), (2048, 8192)]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_tiles_cover_the_picture_and_their_lists_fit_the_kernels(width: int, height: int) -> None:
    tiles = tile_layout(width, height, 100_000)
    assert tiles.columns * tiles.side >= width > (tiles.columns - 1) * tiles.side
    assert tiles.rows * tiles.side >= height > (tiles.rows - 1) * tiles.side
    assert tiles.slices in {4, 8, 16, 32, 64, 128, 256}
    assert tiles.tiles * tiles.slices <= layout.MAX_LISTS or tiles.slices == 4


def test_small_pictures_and_small_gaussians_have_small_tiles() -> None:
    assert [tile_layout(width, height, 100_000).side for width, height in SIZES[:4]] == [8, 8, 8, 16]
    assert tile_layout(1280, 720, 3_000_000).side == 8


def test_a_packed_scene_is_whole_chunks_without_what_cannot_be_drawn() -> None:
    gaussians = cloud(1000, 3)
    gaussians.opacities[:100] = 0.001
    gaussians.means[100] = float("nan")
    scene = pack(gaussians, torch.device("cpu"))
    drawable = int((gaussians.opacities >= 1 / 255).sum()) - int(gaussians.opacities[100] >= 1 / 255)
    assert scene.padded % CHUNK == 0
    assert int((scene.shapes[:, 3] != 0).sum()) == drawable
    assert scene.sh.shape == (12, scene.padded, 4)
    assert scene.nbytes == sum(t.nbytes for t in (scene.means, scene.shapes, scene.sh, scene.bounds))


def test_scales_survive_packing_to_a_tenth_of_a_percent() -> None:
    gaussians = cloud(500, 0, size=0.01)
    scene = pack(gaussians, torch.device("cpu"))
    codes = scene.shapes[:, :3].to(torch.int32) & 0xFFFF
    unpacked = torch.exp2(scene.scale_low + scene.scale_step * codes).sum(1).sort().values[-400:]
    original = gaussians.scales[gaussians.opacities >= 1 / 255].sum(1).sort().values[-400:]
    torch.testing.assert_close(unpacked, original, rtol=1e-3, atol=0)


def test_chunks_bounds_hold_their_means() -> None:
    scene = pack(cloud(2000, 0), torch.device("cpu"))
    points = scene.means.T[:1800].clone()
    centres = scene.bounds[:, None, :3].repeat(1, CHUNK, 1).reshape(-1, 3)[:1800]
    radii = scene.bounds[:, None, 3].repeat(1, CHUNK).reshape(-1)[:1800]
    assert ((points - centres).norm(dim=1) <= radii).all()


def test_degrees_without_coefficients_are_not_kept() -> None:
    sh = torch.zeros(10, 16, 3)
    assert coefficients_in_use(sh) == 1
    sh[3, 5, 1] = 0.1
    assert coefficients_in_use(sh) == 9
    sh[3, 15, 1] = 0.1
    assert coefficients_in_use(sh) == 16


def test_neighbours_in_space_are_neighbours_in_order() -> None:
    points = torch.rand(4096, 3, generator=torch.Generator().manual_seed(0))
    ordered = points[morton_codes(points).argsort()]
    steps, random_steps = (p.diff(dim=0).norm(dim=1).mean() for p in (ordered, points))
    assert steps < 0.25 * random_steps


def test_nothing_packs_to_one_chunk_of_padding() -> None:
    nothing = Gaussians(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0), torch.zeros(0, 1, 3))
    scene = pack(nothing, torch.device("cpu"))
    assert scene.padded == CHUNK
    assert not scene.shapes.any()


def test_parameters_are_laid_out_as_the_kernels_read_them() -> None:
    source = (KERNELS / "frame.cuh").read_text()
    struct = source[source.index("struct Frame {") : source.index("constexpr int FRAME_WORDS")]
    lines = [line.split("//")[0].strip() for line in struct.splitlines()[1:]]
    fields = [line for line in lines if line.endswith(";") and "}" not in line]
    pointers = sum("*" in field for field in fields)
    words = 0
    for field in fields:
        if "*" not in field:
            for name in field.rstrip(";").split(" ", 1)[1].split(","):
                size = re.search(r"\[(\d+)\]", name)
                words += int(size[1]) if size else 1
    assert parameters.LAYOUT.size == -(-(8 * pointers + 4 * words) // 8) * 8


def test_derivative_limits_follow_an_off_centre_picture() -> None:
    k = camera(200, 100, focal=100).intrinsics
    assert parameters.derivative_limits(k) == pytest.approx((-1.3, 1.3, -0.65, 0.65))


def test_derivative_limits_of_the_shortest_focal_length_are_numbers_that_the_kernels_can_hold() -> None:
    limits = parameters.derivative_limits(Intrinsics(1e-300, 1e-300, 640.0, 360.0, 1280, 720))
    assert torch.tensor(limits, dtype=torch.float32).isfinite().all()
    assert limits[0] < 0 < limits[1]


@pytest.mark.parametrize("arch", ["sm_80", "sm_86", "sm_89", "sm_90", "sm_100", "sm_120"])
def test_the_kernels_compile_for_every_generation_from_ampere_on(arch: str) -> None:
    pytest.importorskip("cuda.core", reason="NVRTC and cuda.core are missing: make gpu")
    assert compiler.compile_kernels(arch).startswith(b"\x7fELF")


def test_the_cache_knows_architectures_and_sources_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = tmp_path / "kernels"
    kernels.mkdir()
    (kernels / "a.cu").write_text("one")
    monkeypatch.setattr(compiler, "KERNELS", kernels)
    first = compiler.cached_path("sm_90", tmp_path)
    assert compiler.cached_path("sm_90", tmp_path) == first
    assert compiler.cached_path("sm_80", tmp_path) != first
    (kernels / "a.cu").write_text("two")
    assert compiler.cached_path("sm_90", tmp_path) != first


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    compiler._write_atomically(tmp_path / "file" / "kernels.cubin", b"code")
    compiler._write_atomically(tmp_path / "new" / "kernels.cubin", b"code")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["kernels.cubin"]
