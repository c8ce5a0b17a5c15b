"""Any file in a scene's folder is a scene with finite Gaussians or a broken one with a sentence."""

from __future__ import annotations

import gzip
import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.byte_edits import edited
from tests.fuzz.fuzzers import assert_sentence, effort, found
from tests.fuzz.json_texts import bodies
from tests.fuzz.wire_examples import EXAMPLES
from tests.render.scenes import made_up, plys
from tests.render.scenes import test_streamed_sog as streamed
from tests.render.scenes.test_formats import splat_bytes
from tigas_common.errors import BrokenScene
from tigas_render.scenes.directory import read_scene_file, scan_directory
from tigas_render.scenes.source import SceneMetadata
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.scenes.start_view.view import derive_view
from tigas_render.scenes.streamed_sog import LodMeta
from tigas_render.server.preview import HEIGHT, WIDTH, preview_camera

PIECES = (
    *(b"ply\n", b"format ascii 1.0\n", b"format binary_little_endian 1.0\n", b"format binary_big_endian 1.0\n"),
    *(b"element vertex 3\n", b"element vertex 0\n", b"element vertex 0_0\n"),
    *(b"element vertex +0\n", b"element face 1\n"),
    *(b"element vertex 1000000000000\n", b"element vertex -1\n"),
    *(b"element vertex \xd9\xa3\n", b"element\x0bvertex 0\n"),
    *(b"property float x\n", b"property list uchar int v\n", b"property double opacity\n", b"property uchar rot_0\n"),
    *(b"comment c\n", b"obj_info o\n", b"end_header\n", b"end_header\r\n"),
    *(b"\n", b"\r", b"\0", b" ", b"\t", b"\x0b", b"\x0c"),
    *(b"nan ", b"inf ", b"-1e999 ", b"1e38 ", b"88.7 ", b"0x1p4 "),
    *(b"1_0 ", b"#", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"),
)  # fmt: skip
"""Lines of headers, and values as text and as float32."""
PACKED_PIECES = (
    *(b"NGSP", b"PK\x03\x04", b"PK\x05\x06", b"\x1f\x8b\x08", b"VP8L", b"VP8X", b"VP8 ", b"RIFF", b"meta.json"),
    *(b"ply\n", b"element chunk 2\n", b"element vertex 257\n", b"uint packed_color", b"uchar f_rest_9"),
    *(b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\0", b"\x01", b"\x80", b"\x00\x00\xc0\x7f"),
    *(b"../", b"null", b"1e999", b"-1", b'"count":2147483648', b'"files":[]'),
)  # fmt: skip
"""Magic bytes, names and values of packed scenes."""
MOST_MEMORY = 20_000_000
"""Bytes in addition to the file's."""

WIDE = plys.header([f"double {name}" for name in plys.names(0)], 2) + bytes(8 * 2 * len(plys.names(0)))
TRAILED = (
    plys.binary_ply().replace(b"end_header", b"element face 1\nproperty list uchar int v\nend_header") + b"\x01ABCD"
)
SOUND = (plys.binary_ply(), plys.ascii_ply(), plys.binary_ply(2, 1), plys.ascii_ply(1, 3), WIDE, TRAILED)

files = edited(st.sampled_from(SOUND), PIECES)

PACKED = tuple((made_up.FILES / f"shell{end}").read_bytes() for end in (".compressed.ply", "-3.spz", "-4.spz", ".sog"))
UNZIPPED = gzip.decompress(PACKED[1])
packed = (
    edited(st.sampled_from((*PACKED, splat_bytes(made_up.shell(0)))), PACKED_PIECES)
    | edited(st.just(UNZIPPED), PACKED_PIECES).map(gzip.compress)
    | edited(st.just(UNZIPPED[:16]), PACKED_PIECES).map(lambda start: gzip.compress(start + UNZIPPED[16:]))
)
numbers = st.floats(width=32) | st.sampled_from([88.0, 89.0, -104.0, 3e38, 1e-45, 1e9])


@st.composite
def absurd_gaussians(draw: st.DrawFn) -> bytes:
    """A valid header, and implausible values."""
    rows = plys.rows(4)
    for _ in range(draw(st.integers(1, 8))):
        row, column = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, rows.shape[1] - 1))
        rows[row, column] = draw(numbers)
    return plys.header(plys.names(0), len(rows)) + rows.tobytes()


@pytest.mark.slow
@effort(150)
@given(content=files | absurd_gaussians())
@found("ply", content=bytes)
def test_any_ply_loads_or_is_broken(content: bytes) -> None:
    assert_loads_or_is_broken(content)


@pytest.mark.filterwarnings("ignore:Generating overly large repr")
@effort(40)
@given(packed)
def test_any_packed_scene_loads_or_is_broken(content: bytes) -> None:
    assert_loads_or_is_broken(content)


@effort(40)
@given(bodies(LodMeta, [streamed.META]))
def test_any_streamed_scene_loads_or_is_broken(index: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert_file_loads_or_is_broken(streamed.write(Path(folder), index))


def assert_loads_or_is_broken(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert_file_loads_or_is_broken(plys.write(Path(folder, "scene", "scene.ply"), content))


def assert_file_loads_or_is_broken(path: Path) -> None:
    """It becomes finite Gaussians that can be looked at, or a sentence, in bounded memory."""
    tracemalloc.start()
    try:
        gaussians = read_scene_file(path).load()
    except BrokenScene as error:
        assert_sentence(error.detail)
        return
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < MOST_MEMORY + 300 * path.stat().st_size
    assert len(gaussians) > 0
    assert all(np.isfinite(array).all() for array in gaussians.arrays)
    view = derive_view(gaussians)
    preview_camera(view.camera, view.up, WIDTH, HEIGHT)


@effort(100)
@given(description=bodies(SceneMetadata, EXAMPLES[SceneMetadata]), content=files)
@found("ply", description=lambda _: b"{}", content=bytes)
def test_a_broken_scene_takes_no_other_with_it(description: bytes, content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        models = Path(folder)
        plys.write(models / "odd" / "scene.json", description)
        plys.write(models / "odd" / "scene.ply", content)
        plys.write(models / "sound" / "scene.ply", plys.binary_ply())
        sources = scan_directory(models)
        assert set(sources) == {"odd", "sound"}
        assert sources["sound"].error is None
        odd = sources["odd"]
        assert (odd.open is None) == (odd.error is not None)
        if odd.error is not None:
            assert_sentence(odd.error)


@pytest.mark.slow
@effort(100)
@given(description=bodies(SceneMetadata, EXAMPLES[SceneMetadata]))
@found("scene-json", description=bytes)
def test_whatever_a_description_says_there_is_a_view_to_begin_with(description: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        models = Path(folder)
        plys.write(models / "scene" / "scene.json", description)
        plys.write(models / "scene" / "scene.ply", plys.binary_ply())
        source = scan_directory(models)["scene"]
    if source.error is not None:
        return
    gaussians, metadata = plys.gaussians(10), source.metadata
    for view in (derive_view(gaussians, metadata.up), SceneStatistics.of(gaussians).view(metadata)):
        pose = preview_camera(view.camera, view.up, WIDTH, HEIGHT).pose
        assert abs(sum(part * part for part in pose.quaternion) - 1) < 1e-6
