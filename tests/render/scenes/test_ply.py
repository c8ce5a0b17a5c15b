"""Loading and writing scene files: every value in its place."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from reference.ply import write_ply
from tests.render.arrays import gaussians_of
from tests.render.scenes import plys
from tests.shared_data import reference_scene_ply
from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Gaussians
from tigas_render.scenes import ply
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.scene_file import BLOCK, Floats, Rows


def assert_same(a: Gaussians, b: Gaussians, rtol: float = 1e-5, atol: float = 1e-6) -> None:
    for name in ("means", "scales", "quaternions", "opacities", "sh"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=rtol, atol=atol)


def test_activations_are_applied(tmp_path: Path) -> None:
    values = dict.fromkeys(plys.names(0), 0.0)
    values |= {"x": 1, "y": 2, "z": 3, "f_dc_0": 0.1, "f_dc_1": 0.2, "f_dc_2": 0.3, "opacity": np.log(3)}
    values |= {"scale_0": np.log(2), "scale_1": np.log(4), "scale_2": np.log(8), "rot_0": 3, "rot_2": 4}
    content = plys.header(list(values), 1) + np.array(list(values.values()), "<f4").tobytes()
    scene = read_scene_file(plys.write(tmp_path / "one.ply", content)).load()
    assert_same(
        scene,
        gaussians_of(
            means=[[1.0, 2.0, 3.0]],
            scales=[[2.0, 4.0, 8.0]],
            quaternions=[[0.6, 0.0, 0.8, 0.0]],
            opacities=[0.75],
            sh=[[[0.1, 0.2, 0.3]]],
        ),
    )


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
@pytest.mark.parametrize("make", [plys.binary_ply, plys.ascii_ply])
def test_coefficients_are_channel_major(tmp_path: Path, make: object, sh_degree: int) -> None:
    content = make(5, sh_degree)  # type: ignore[operator]
    path = plys.write(tmp_path / "scene.ply", content)
    scene = read_scene_file(path).load()
    per_channel = (sh_degree + 1) ** 2 - 1
    columns = dict(zip(plys.names(sh_degree), plys.rows(5, sh_degree).T, strict=True))
    assert read_scene_file(path).sh_degree == scene.sh_degree == sh_degree
    assert scene.sh.shape == (5, per_channel + 1, 3)
    for channel in range(3):
        for k in range(per_channel):
            expected = columns[f"f_rest_{channel * per_channel + k}"]
            np.testing.assert_array_equal(scene.sh[:, 1 + k, channel], expected)


def test_text_and_binary_give_the_same_scene(tmp_path: Path) -> None:
    binary = read_scene_file(plys.write(tmp_path / "binary.ply", plys.binary_ply(50, 3))).load()
    text = read_scene_file(plys.write(tmp_path / "text.ply", plys.ascii_ply(50, 3))).load()
    assert_same(binary, text)


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_what_is_written_is_read_back(tmp_path: Path, sh_degree: int) -> None:
    scene = plys.gaussians(2 * BLOCK + 7, sh_degree)  # more than one block
    write_ply(tmp_path / "scene.ply", scene)
    assert_same(read_scene_file(tmp_path / "scene.ply").load(), scene)


def test_gaussians_that_are_not_finite_are_dropped_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    values, columns = plys.rows(BLOCK + 10, 1), plys.names(1)
    values[3, columns.index("x")] = np.nan
    values[4, columns.index("f_rest_8")] = np.inf
    values[5, columns.index("scale_1")] = 200  # finite, but not its exponential
    values[6, [columns.index(f"rot_{i}") for i in range(4)]] = 0
    values[BLOCK + 2, columns.index("opacity")] = -np.inf
    values[7, [columns.index(f"rot_{i}") for i in range(4)]] = 1e30  # its square overflows; the rotation is sound
    path = plys.write(tmp_path / "scene.ply", plys.header(columns, len(values)) + values.tobytes())
    with caplog.at_level(logging.WARNING):
        scene = read_scene_file(path).load()
    assert len(scene) == BLOCK + 5
    assert f"dropped 5 of {BLOCK + 10}" in caplog.text
    np.testing.assert_allclose(scene.quaternions[3], 0.5, rtol=1e-6)
    for array in scene.arrays:
        assert np.isfinite(array).all()
        assert len(array) == len(scene)


@pytest.mark.parametrize(("name", "value"), [("scale_1", 88.0), ("scale_0", 21.0), ("x", 3e38), ("z", -1.1e9)])
def test_a_gaussian_without_measure_is_dropped_and_changes_no_picture(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str, value: float
) -> None:
    values, columns = plys.rows(5), plys.names(0)
    values[2, columns.index(name)] = value
    others = np.delete(values, 2, axis=0)
    with caplog.at_level(logging.WARNING):
        scene = read_scene_file(plys.write(tmp_path / "scene.ply", plys.header(columns, 5) + values.tobytes())).load()
    assert "dropped 1 of 5" in caplog.text
    assert_same(
        scene, read_scene_file(plys.write(tmp_path / "others.ply", plys.header(columns, 4) + others.tobytes())).load()
    )


def test_a_scene_without_any_finite_gaussian_is_broken(tmp_path: Path) -> None:
    content = plys.header(plys.names(0), 2) + np.full((2, 17), np.nan, "<f4").tobytes()
    with pytest.raises(BrokenScene, match="no Gaussian whose attributes are finite"):
        read_scene_file(plys.write(tmp_path / "scene.ply", content)).load()


def test_other_properties_types_and_elements_are_put_up_with(tmp_path: Path) -> None:
    fields = [("id", "<i4"), *((name, "<f8") for name in plys.names(0)), ("red", "u1")]
    kinds = {"<i4": "int", "<f8": "double", "u1": "uchar"}
    data = np.zeros(4, fields)
    for name, column in zip(plys.names(0), plys.rows(4).T, strict=True):
        data[name] = column
    data["x"][1] = 1e300  # infinite as float32, without any warning
    cameras = np.arange(6, dtype="<f4").tobytes()
    content = plys.header([f"{kinds[kind]} {name}" for name, kind in fields], 4)
    content = content.replace(
        b"element vertex",
        b"comment made by a test\nelement camera 2\nproperty float a\nproperty float b\n"
        b"property float c\nelement vertex",
    ).replace(b"end_header", b"element face 1\nproperty list uchar int vertex_indices\nend_header")
    faces = b"\x03" + np.arange(3, dtype="<i4").tobytes()
    scene = read_scene_file(plys.write(tmp_path / "scene.ply", content + cameras + data.tobytes() + faces)).load()
    plain = read_scene_file(plys.write(tmp_path / "plain.ply", plys.binary_ply(4))).load()
    assert len(scene) == 3
    np.testing.assert_array_equal(scene.means, plain.means[[0, 2, 3]])
    np.testing.assert_array_equal(scene.opacities, plain.opacities[[0, 2, 3]])


def test_text_may_have_other_elements_and_windows_line_ends(tmp_path: Path) -> None:
    content = plys.ascii_ply(4).replace(
        b"element vertex", b"element camera 2\nproperty list int float v\nelement vertex"
    )
    content = content.replace(b"end_header\n", b"end_header\n1 5\n2 5 6\n").replace(b"\n", b"\r\n")
    scene = read_scene_file(plys.write(tmp_path / "scene.ply", content)).load()
    assert_same(scene, read_scene_file(plys.write(tmp_path / "plain.ply", plys.binary_ply(4))).load())


def test_a_comment_may_have_any_characters(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(plys.binary_ply().replace(b"element", "comment von Jürgen\nelement".encode(), 1))
    assert len(read_scene_file(path).load()) == 3


def test_a_file_that_is_cut_short_while_it_is_read_is_broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(plys.binary_ply(2 * BLOCK, sh_degree=1))
    file, values = read_scene_file(path), ply._values

    def cut(block: Rows, names: Sequence[str]) -> Floats:
        path.write_bytes(b"")
        return values(block, names)

    monkeypatch.setattr(ply, "_values", cut)
    with pytest.raises(BrokenScene, match="changed while it was being read"):
        file.load()


def test_huge_numbers_in_text_drop_their_gaussian(tmp_path: Path) -> None:
    lines = plys.ascii_ply(3).decode().splitlines()
    lines[-2] = " ".join(["1e39", "1" + "0" * 400, *lines[-2].split()[2:]])
    scene = read_scene_file(plys.write(tmp_path / "scene.ply", "\n".join(lines).encode())).load()
    assert len(scene) == 2


def test_a_captured_scene_loads(caplog: pytest.LogCaptureFixture) -> None:
    scene = read_scene_file(reference_scene_ply("guitar")).load()
    assert len(scene) == 90_854
    assert scene.sh_degree == 0
    assert not caplog.records
