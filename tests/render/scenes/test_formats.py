"""One scene in all formats: nearly the same picture, under any file name."""

from __future__ import annotations

import gzip
import json
import struct
import tracemalloc
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree

from reference.ply import write_ply
from reference.rasterizer import ReferenceRasterizer, rotation_matrices
from tests.render.raster.views import psnr
from tests.render.scenes import made_up, plys
from tests.shared_data import reference_scene_ply, shared_file
from tigas_common.errors import BrokenScene
from tigas_common.pose import Intrinsics, Pose
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.scenes import scene_file
from tigas_render.scenes.compressed_ply import write_compressed_ply
from tigas_render.scenes.directory import read_scene_file

PLACE = (2.0, 1.0, 2.0)
"""Where the pictures are seen from."""


def tool_made(name: str) -> Callable[[Path], object]:
    return lambda path: path.write_bytes((made_up.FILES / name).read_bytes())


def splat_bytes(scene: Gaussians) -> bytes:
    records = np.zeros(len(scene), [("f", "<f4", 6), ("u", "u1", 8)])
    records["f"] = np.concatenate((scene.means, scene.scales), axis=1)
    colours = np.column_stack((scene.sh[:, 0] * 0.28209479 + 0.5, scene.opacities))
    records["u"] = np.concatenate((colours * 255, scene.quaternions * 128 + 128), axis=1).clip(0, 255).round()
    return records.tobytes()


def spz_2(path: Path, **header: int) -> None:
    path.write_bytes(gzip.compress(spz_bytes(made_up.shell(), **header)))


def spz_bytes(scene: Gaussians, **header: int) -> bytes:
    """Version 2, before gzip."""
    fields = {"version": 2, "count": len(scene), "degree": scene.sh_degree, "bits": 12, "flags": 0, "reserved": 0}
    fields |= header
    fixed: NDArray[np.uint8] = np.rint(scene.means * 4096).astype("<i4").view("u1").reshape(-1, 3, 4)[..., :3]
    positive = np.where(scene.quaternions[:, :1] < 0, -scene.quaternions, scene.quaternions)
    columns = (
        scene.opacities * 255,
        (scene.sh[:, 0] * 0.15 + 0.5) * 255,
        (np.log(scene.scales) + 10) * 16,
        positive[:, 1:] * 127.5 + 127.5,
        scene.sh[:, 1:] * 128 + 128,
    )
    parts = (column.round().clip(0, 255).astype("u1").tobytes() for column in columns)
    return struct.pack("<4sIIBBBB", b"NGSP", *fields.values()) + fixed.tobytes() + b"".join(parts)


FORMATS: dict[str, tuple[Callable[[Path], object], str, int]] = {
    "PLY": (lambda path: write_ply(path, made_up.shell()), "PLY", 1),
    "compressed PLY": (tool_made("shell.compressed.ply"), "compressed PLY", 1),
    "our compressed PLY": (
        lambda path: write_compressed_ply(path, made_up.shell(), np.arange(made_up.COUNT)),
        "compressed PLY",
        1,
    ),
    ".splat": (lambda path: path.write_bytes(splat_bytes(made_up.shell(0))), ".splat", 0),
    "SPZ 2": (spz_2, "SPZ 2", 1),
    "SPZ 3": (tool_made("shell-3.spz"), "SPZ 3", 1),
    "SPZ 4": (tool_made("shell-4.spz"), "SPZ 4", 1),
    "SOG": (tool_made("shell.sog"), "SOG", 1),
}


@pytest.mark.parametrize(("write", "name", "sh_degree"), FORMATS.values(), ids=FORMATS)
def test_every_format_shows_the_scene(
    tmp_path: Path, write: Callable[[Path], object], name: str, sh_degree: int
) -> None:
    path = tmp_path / "called.anything"
    write(path)
    file = read_scene_file(path)
    assert (file.format, file.count, file.sh_degree) == (name, made_up.COUNT, sh_degree)
    assert file.file_bytes == path.stat().st_size
    loaded = file.load()
    assert psnr(picture(loaded), shell_picture(sh_degree)) > 40
    assert_same_shapes(loaded, made_up.shell())


@pytest.mark.parametrize("format", ["PLY", "compressed PLY", ".splat"])
def test_every_fourth_gaussian_is_the_coarse_part_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    monkeypatch.setattr(scene_file, "SAMPLE", made_up.COUNT // 4)
    FORMATS[format][0](tmp_path / "scene")
    file = read_scene_file(tmp_path / "scene")
    coarse = file.coarse()
    assert coarse is not None
    assert (coarse.count, coarse.sh_degree) == (made_up.COUNT // 4, 0)
    means, scales, quaternions, opacities, sh = (array[::4] for array in file.load().arrays)
    expected = (means, scales * scene_file.enlargement(4), quaternions, opacities, sh[:, :1])
    assert all(map(np.allclose, coarse.load().arrays, expected))


@pytest.mark.parametrize("format", ["SPZ 2", "SOG"])
def test_a_packed_file_has_no_coarse_part(tmp_path: Path, format: str) -> None:
    FORMATS[format][0](tmp_path / "scene")
    assert read_scene_file(tmp_path / "scene").coarse() is None


def test_a_sog_scene_in_a_folder_is_the_same_as_in_one_file(tmp_path: Path) -> None:
    file = read_scene_file(made_up.unzip(tmp_path) / "meta.json")
    assert (file.format, len(file.files)) == ("SOG folder", 8)
    bundled = read_scene_file(made_up.FILES / "shell.sog").load()
    assert all(map(np.array_equal, file.load().arrays, bundled.arrays))


@pytest.mark.parametrize("degree", [0, 2, 3])
def test_all_degrees_of_spherical_harmonics_survive_packing(tmp_path: Path, degree: int) -> None:
    scene = made_up.shell(degree)
    write_compressed_ply(tmp_path / "ply", scene, np.arange(len(scene)))
    (tmp_path / "spz").write_bytes(gzip.compress(spz_bytes(scene)))
    for name, step in (("ply", 8 / 255), ("spz", 1 / 128)):
        loaded = read_scene_file(tmp_path / name).load()
        assert loaded.sh_degree == degree
        assert np.allclose(loaded.sh[:, 1:], scene.sh[:, 1:], rtol=0, atol=step)


def sog_that_says(path: Path, **said: object) -> None:
    """As a folder, with these entries in its meta.json."""
    meta = made_up.unzip(path.parent) / "meta.json"
    meta.rename(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **said}))


COMMENTS: dict[tuple[str, ...], bool] = {
    (): False,
    ("SplatRenderMode: mip",): True,
    ("SplatRenderMode: default",): False,
    ("antialiased 1",): True,
    ("antialiased 1", "antialiased 0"): False,
    ("antialiased as if",): False,
}
SAID: list[tuple[dict[str, Any], bool]] = [
    ({}, False),
    ({"antialias": True}, True),
    ({"model": "antialiased"}, True),
    ({"model": "2dgs"}, False),
    ({"model": [1]}, False),
]
FEW = plys.gaussians(3)
TRAINED: list[tuple[Callable[[Path], object], bool]] = [
    *((partial(write_ply, gaussians=FEW, comments=comments), said) for comments, said in COMMENTS.items()),
    *(
        (partial(write_compressed_ply, gaussians=FEW, order=np.arange(3), comments=comments), said)
        for comments, said in COMMENTS.items()
    ),
    *((partial(spz_2, flags=int(said)), said) for said in (False, True)),
    *((partial(sog_that_says, **entries), said) for entries, said in SAID),
]


@pytest.mark.parametrize(("write", "antialiased"), TRAINED)
def test_a_file_says_how_its_scene_was_trained(
    tmp_path: Path, write: Callable[[Path], object], antialiased: bool
) -> None:
    path = tmp_path / "scene"
    write(path)
    assert read_scene_file(path).antialiased is antialiased
    assert read_scene_file(path).load().antialiased is antialiased


MANY = plys.gaussians(60_000, 3)
LARGE: dict[str, Callable[[Path], object]] = {
    "PLY": partial(write_ply, gaussians=MANY),
    "PLY as text": lambda path: path.write_bytes(plys.ascii_ply(40_000)),
    "compressed PLY": partial(write_compressed_ply, gaussians=MANY, order=np.arange(len(MANY))),
    "SPZ": lambda path: path.write_bytes(gzip.compress(spz_bytes(MANY), 1)),
    ".splat": lambda path: path.write_bytes(splat_bytes(MANY)),
}


@pytest.mark.parametrize("write", LARGE.values(), ids=LARGE)
def test_reading_takes_little_memory_whatever_the_scenes_size(tmp_path: Path, write: Callable[[Path], object]) -> None:
    write(tmp_path / "scene")
    read_scene_file(made_up.FILES / "shell-3.spz").load()  # so that nothing is imported while memory is counted
    file = read_scene_file(tmp_path / "scene")
    tracemalloc.start()
    heard: list[float] = []
    count = sum(map(len, file.open(heard.append).parts))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == file.count
    assert peak < 6_000_000
    assert heard == sorted(heard)
    assert len(heard) > 4
    assert heard[-1] == 1


@pytest.mark.parametrize(("name", "file"), [("guitar", "guitar.compressed.ply"), ("narcissus", "narcissus.sog")])
def test_captured_scenes_are_what_another_decoder_makes_of_them(name: str, file: str) -> None:
    paths = (shared_file("scenes", file), reference_scene_ply(name))
    loaded, expected = (read_scene_file(path).load() for path in paths)
    assert all(map(partial(np.allclose, atol=2e-6), loaded.arrays, expected.arrays))


def test_what_is_no_scene_says_so(tmp_path: Path) -> None:
    for content in (b"\x89PNG\r\n" + bytes(90), b"a letter " * 32, np.full(64, np.nan, "<f4").tobytes()):
        (tmp_path / "scene.splat").write_bytes(content)
        with pytest.raises(BrokenScene, match=r"^scene\.splat is not a scene: it is neither PLY, SPZ, SOG nor"):
            read_scene_file(tmp_path / "scene.splat")


@cache
def shell_picture(sh_degree: int) -> NDArray[np.uint8]:
    return picture(made_up.shell(sh_degree))


def picture(scene: Gaussians) -> NDArray[np.uint8]:
    rasterizer = ReferenceRasterizer()
    lens = Intrinsics(fx=60, fy=60, cx=32, cy=18, width=64, height=36)
    view = Camera(Pose.look_at(PLACE, (0, 0, 0), (0, -1, 0)), lens)
    with rasterizer.render(rasterizer.prepare(scene), view) as image:
        return image.to_host().copy()


def assert_same_shapes(loaded: Gaussians, expected: Gaussians) -> None:
    """In any order: each Gaussian's covariance, against that of the nearest one.

    SPZ 2 is rough where w is near 0.
    """
    _, nearest = KDTree(expected.means).query(loaded.means)
    assert len(set(nearest.tolist())) == len(expected)
    difference = np.abs(covariances(loaded) - covariances(expected)[nearest]).max()
    assert difference < 0.15 * np.abs(covariances(expected)).max()


def covariances(scene: Gaussians) -> NDArray[np.float32]:
    quaternions, scales = torch.from_numpy(scene.quaternions), torch.from_numpy(scene.scales)
    axes = rotation_matrices(quaternions) * scales[:, None, :]
    return (axes @ axes.mT).numpy()
