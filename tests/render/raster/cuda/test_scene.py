"""A packed scene holds the drawable Gaussians, in whole chunks, to the precision that a picture needs."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.render.raster.views import cloud
from tigas_render.gaussians import Gaussians
from tigas_render.raster.cuda import packing
from tigas_render.raster.cuda.packing import coefficients_in_use, pack
from tigas_render.raster.cuda.scene import CHUNK


def test_a_packed_scene_is_whole_chunks_without_what_cannot_be_drawn() -> None:
    gaussians = cloud(1000, 3)
    gaussians.opacities[:100] = 0.001
    gaussians.means[100] = float("nan")
    scene = pack(gaussians.batches(), torch.device("cpu"))
    drawable = int((gaussians.opacities >= 1 / 255).sum()) - int(gaussians.opacities[100] >= 1 / 255)
    assert scene.padded % CHUNK == 0
    assert int((scene.shapes[:, 3] != 0).sum()) == drawable
    assert scene.sh.shape == (12, scene.padded, 4)
    assert scene.nbytes == sum(t.nbytes for t in (scene.means, scene.shapes, scene.sh, scene.bounds))


def test_scales_survive_packing_to_a_tenth_of_a_percent() -> None:
    gaussians = cloud(500, 0, size=0.01)
    scene = pack(gaussians.batches(), torch.device("cpu"))
    unpacked = scene.scale_codes.scales(scene.shapes).sum(1).sort().values[-400:]
    original = np.sort(gaussians.scales[gaussians.opacities >= 1 / 255].sum(1))[-400:]
    np.testing.assert_allclose(unpacked, original, rtol=1e-3)


def test_chunks_bounds_hold_their_means() -> None:
    scene = pack(cloud(2000, 0).batches(), torch.device("cpu"))
    points = scene.means.T[:1800].clone()
    centres = scene.bounds[:, None, :3].repeat(1, CHUNK, 1).reshape(-1, 3)[:1800]
    radii = scene.bounds[:, None, 3].repeat(1, CHUNK).reshape(-1)[:1800]
    assert ((points - centres).norm(dim=1) <= radii).all()


def test_a_scene_packed_piece_by_piece_is_that_packed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians = cloud(3000, 2)
    at_once = pack(gaussians.batches(), torch.device("cpu"))
    monkeypatch.setattr(packing, "AT_ONCE", 2 * CHUNK)
    in_pieces = pack(gaussians.batches(), torch.device("cpu"))
    assert in_pieces.scale_codes == at_once.scale_codes
    for name in ("means", "shapes", "sh", "bounds"):
        one, other = (getattr(scene, name).view(torch.uint8) for scene in (in_pieces, at_once))
        assert torch.equal(one, other), name


def test_degrees_without_coefficients_are_not_kept() -> None:
    sh = torch.zeros(10, 16, 3)
    assert coefficients_in_use(sh) == 1
    sh[3, 5, 1] = 0.1
    assert coefficients_in_use(sh) == 9
    sh[3, 15, 1] = 0.1
    assert coefficients_in_use(sh) == 16


def test_nothing_packs_to_one_chunk_of_padding() -> None:
    nothing = Gaussians(*(array[:0] for array in cloud(1, 0).arrays))
    scene = pack(nothing.batches(), torch.device("cpu"))
    assert scene.padded == CHUNK
    assert not scene.shapes.any()
