"""One scene in all formats: nearly the same picture, under any file name."""

from __future__ import annotations

import gzip
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from reference.ply import write_ply
from reference.rasterizer import ReferenceRasterizer
from tests.render.raster.views import psnr
from tests.render.scenes import made_up, plys
from tests.shared_data import reference_scene_ply, shared_file
from tigas_common.errors import BrokenScene
from tigas_common.pose import Intrinsics, Pose
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.scenes.compressed_ply import write_compressed_ply
from tigas_render.scenes.directory import read_scene_file

PLACE = (2.0, 1.0, 2.0)
"""Where the pictures are seen from."""


def tool_made(name: str) -> Callable[[Path], object]:
    return lambda path: path.write_bytes((made_up.FILES / name).read_bytes())


def splat(path: Path) -> None:
    scene = made_up.shell(0)
    path.write_bytes(splat_bytes(scene))


def splat_bytes(scene: Gaussians) -> bytes:
    records = np.zeros(len(scene), [("f", "<f4", 6), ("u", "u1", 8)])
    records["f"] = np.concatenate((scene.means, scene.scales), axis=1)
    colours = np.column_stack((scene.sh[:, 0] * 0.28209479 + 0.5, scene.opacities))
    records["u"] = np.concatenate((colours * 255, scene.quaternions * 128 + 128), axis=1).clip(0, 255).round()
    return records.tobytes()


def spz_2(path: Path) -> None:
    path.write_bytes(gzip.compress(spz_bytes(made_up.shell())))


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
    ".splat": (splat, ".splat", 0),
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


def test_a_sog_scene_in_a_folder_is_the_same_as_in_one_file(tmp_path: Path) -> None:
    with zipfile.ZipFile(made_up.FILES / "shell.sog") as bundle:
        bundle.extractall(tmp_path)
    file = read_scene_file(tmp_path / "meta.json")
    assert (file.format, len(file.files)) == ("SOG folder", 8)
    bundled, loaded = read_scene_file(made_up.FILES / "shell.sog").load(), file.load()
    for name in ("means", "scales", "quaternions", "opacities", "sh"):
        assert np.array_equal(getattr(loaded, name), getattr(bundled, name)), name


@pytest.mark.parametrize("degree", [0, 2, 3])
def test_all_degrees_of_spherical_harmonics_survive_packing(tmp_path: Path, degree: int) -> None:
    scene = made_up.shell(degree)
    write_compressed_ply(tmp_path / "ply", scene, np.arange(len(scene)))
    (tmp_path / "spz").write_bytes(gzip.compress(spz_bytes(scene)))
    for name, step in (("ply", 8 / 255), ("spz", 1 / 128)):
        loaded = read_scene_file(tmp_path / name).load()
        assert loaded.sh_degree == degree
        assert np.allclose(loaded.sh[:, 1:], scene.sh[:, 1:], rtol=0, atol=step)


@pytest.mark.parametrize(
    ("comments", "antialiased"),
    [
        ([], False),
        (["SplatRenderMode: mip"], True),
        (["SplatRenderMode: default"], False),
        (["antialiased 1"], True),
        (["antialiased 1", "antialiased 0"], False),
        (["antialiased as if"], False),
    ],
)
def test_a_ply_says_how_it_was_trained(tmp_path: Path, comments: list[str], antialiased: bool) -> None:
    scene = plys.gaussians(3)
    write_ply(tmp_path / "scene.ply", scene, comments=comments)
    write_compressed_ply(tmp_path / "packed.ply", scene, np.arange(3), comments=comments)
    for name in ("scene.ply", "packed.ply"):
        assert read_scene_file(tmp_path / name).antialiased is antialiased
        assert read_scene_file(tmp_path / name).load().antialiased is antialiased


def test_an_spz_says_how_it_was_trained(tmp_path: Path) -> None:
    for flags in (0, 1):
        (tmp_path / "scene.spz").write_bytes(gzip.compress(spz_bytes(made_up.shell(), flags=flags)))
        assert read_scene_file(tmp_path / "scene.spz").antialiased is bool(flags)
        assert read_scene_file(tmp_path / "scene.spz").load().antialiased is bool(flags)


@pytest.mark.parametrize(
    ("said", "antialiased"),
    [
        ({}, False),
        ({"antialias": True}, True),
        ({"model": "antialiased"}, True),
        ({"model": "2dgs"}, False),
        ({"model": [1]}, False),
    ],
)
def test_a_sog_says_how_it_was_trained(tmp_path: Path, said: dict[str, object], antialiased: bool) -> None:
    with zipfile.ZipFile(made_up.FILES / "shell.sog") as bundle:
        bundle.extractall(tmp_path)
    meta = tmp_path / "meta.json"
    meta.write_text(json.dumps({**json.loads(meta.read_text()), **said}))
    assert read_scene_file(meta).antialiased is antialiased
    assert read_scene_file(meta).load().antialiased is antialiased


@pytest.mark.parametrize("name", ["ply", "spz", "splat"])
def test_reading_takes_little_memory_whatever_the_scenes_size(tmp_path: Path, name: str) -> None:
    scene = plys.gaussians(60_000, 0 if name == "splat" else 3)
    path = tmp_path / name
    if name == "ply":
        write_compressed_ply(path, scene, np.arange(len(scene)))
    else:
        path.write_bytes(gzip.compress(spz_bytes(scene), 1) if name == "spz" else splat_bytes(scene))
    read_scene_file(made_up.FILES / "shell-3.spz").load()  # so that nothing is imported while memory is counted
    tracemalloc.start()
    heard: list[float] = []
    count = sum(map(len, read_scene_file(path).open(heard.append).parts))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == len(scene)
    assert peak < min(5_000_000, scene.nbytes)
    assert heard == sorted(heard)
    assert len(heard) > 10
    assert heard[-1] == 1


@pytest.mark.parametrize(("name", "file"), [("guitar", "guitar.compressed.ply"), ("narcissus", "narcissus.sog")])
def test_captured_scenes_are_what_another_decoder_makes_of_them(name: str, file: str) -> None:
    paths = (shared_file("scenes", file), reference_scene_ply(name))
    loaded, expected = (read_scene_file(path).load() for path in paths)
    for part in ("means", "scales", "quaternions", "opacities", "sh"):
        assert np.allclose(getattr(loaded, part), getattr(expected, part), atol=2e-6), part


def test_what_is_no_scene_says_so(tmp_path: Path) -> None:
    for content in (b"\x89PNG\r\n" + bytes(90), b"a letter " * 32, np.full(64, np.nan, "<f4").tobytes()):
        (tmp_path / "scene.splat").write_bytes(content)
        with pytest.raises(BrokenScene, match=r"^scene\.splat is no scene: it is neither PLY, SPZ, SOG nor \.splat\.$"):
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
    w, x, y, z = scene.quaternions.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    axes = np.moveaxis(np.array(rows), 2, 0) * scene.scales[:, None, :]
    matrices: NDArray[np.float32] = axes @ axes.transpose(0, 2, 1)
    return matrices
