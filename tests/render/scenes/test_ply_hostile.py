"""Malformed files: each gets one sentence on its fault."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from tests.render.scenes import plys
from tigas_common.errors import BrokenScene
from tigas_render.scenes.ply import load_ply
from tigas_render.scenes.ply_header import MAX_HEADER, read_header

GOOD, TEXT = plys.binary_ply(), plys.ascii_ply()
FLOATS = plys.names(0)


def text_with(line: int, new: str) -> bytes:
    lines = TEXT.decode().splitlines()
    lines[line] = new
    return "\n".join(lines).encode() + b"\n"


def without(*gone: str) -> bytes:
    kept = [name for name in FLOATS if name not in gone]
    return plys.header(kept, 1) + bytes(4 * len(kept))


HEADER = {
    "empty": (b"", "is empty"),
    "not a PLY": (b"PK\x03\x04" + bytes(100), "does not begin with 'ply'"),
    "ply in its name only": (b"plywood\n", "does not begin with 'ply'"),
    "cut in the header": (GOOD[:60], "truncated: its header has no 'end_header'"),
    "oversized header": (b"ply\n" + b"comment x\n" * (MAX_HEADER // 8), "header of more than 64 KiB"),
    "header without line ends": (b"ply\n" + b"x" * 200_000, "header of more than 64 KiB"),
    "cut in the data": (GOOD[:-1], "truncated: 3 vertices make"),
    "cut before the data": (plys.header(FLOATS, 3), "truncated: 3 vertices make"),
    "bytes left over": (GOOD + b"\0", "longer than its header says"),
    "10¹² vertices": (plys.header(FLOATS, 10**12) + bytes(68), "1000000000000 vertices make 68000000000423 bytes"),
    "10¹² vertices as text": (
        plys.header(FLOATS, 10**12, "ascii") + b"0 " * 34,
        "1000000000000 vertices make at least",
    ),
    "10³⁰ vertices": (plys.header(FLOATS, 10**30) + bytes(68), "impossible number"),
    "10⁵⁰⁰⁰ vertices": (plys.header(FLOATS, 3).replace(b"x 3", b"x " + b"9" * 5000), "impossible number"),
    "negative count": (plys.header(FLOATS, -1), "broken PLY header"),
    "no count": (GOOD.replace(b"element vertex 3", b"element vertex"), "broken PLY header"),
    "an underscore in the count": (plys.header(FLOATS, 3).replace(b"x 3", b"x 0_0"), "line 3 is not 'element', a name"),
    "a sign before the count": (plys.header(FLOATS, 3).replace(b"x 3", b"x +0"), "line 3 is not 'element', a name"),
    "a sign before 10¹²": (plys.header(FLOATS, 3).replace(b"x 3", b"x +1000000000000"), "line 3 is not 'element'"),
    "a vertical tab": (GOOD.replace(b"element vertex", b"element\x0bvertex"), "line 3 is not plain ASCII text"),
    "a carriage return": (GOOD.replace(b"element vertex", b"element\rvertex"), "line 3 is not plain ASCII text"),
    "a tab": (GOOD.replace(b"element vertex", b"element\tvertex"), "line 3 is not plain ASCII text"),
    "a line with an indent": (GOOD.replace(b"element vertex", b" element vertex"), "line 3 is not plain ASCII text"),
    "zero vertices": (plys.header(FLOATS, 0), "0 vertices"),
    "no vertices": (GOOD.replace(b"element vertex", b"element points"), "no element 'vertex'"),
    "two vertex elements": (
        GOOD.replace(b"end_header", b"element vertex 1\nproperty float x\nend_header"),
        "same name",
    ),
    "big-endian": (GOOD.replace(b"little", b"big"), "big-endian"),
    "unknown format": (GOOD.replace(b"binary_little_endian", b"morse"), "broken PLY header"),
    "unknown type": (GOOD.replace(b"property float y", b"property quad y"), "broken PLY header"),
    "not ASCII": (GOOD.replace(b"element", b"comment \xff\xfe\nelement", 1), "broken PLY header"),
    "property twice": (GOOD.replace(b"property float nx", b"property float x"), "same name"),
    "first missing property": (without("f_dc_1", "rot_2"), "no property 'f_dc_1'"),
    "a mesh": (plys.header(["x", "y", "z", "uchar red"], 1) + bytes(13), "no property 'f_dc_0'"),
    "a list": (GOOD.replace(b"property float nx", b"property list uchar float nx"), "a list as property 'nx'"),
    "lists before the vertices": (
        GOOD.replace(b"element vertex", b"element face 1\nproperty list uchar int v\nelement vertex"),
        "lists in element 'face' before",
    ),
    "8 f_rest": (plys.header([*FLOATS, *(f"f_rest_{i}" for i in range(8))], 1) + bytes(100), "8 properties f_rest_*"),
    "f_rest with a gap": (
        plys.header([*FLOATS, *(f"f_rest_{i}" for i in (*range(8), 9))], 1) + bytes(104),
        "no 'f_rest_8'",
    ),
}

DATA = {
    "too few rows": (TEXT.rsplit(b"\n", 2)[0] + b"\n", "promises 3 vertices and has 2"),
    "too few columns": (text_with(-2, "1 2 3 " + "4" * 400), "cannot be read"),
    "too many columns": (text_with(-1, "0 " * 18), "cannot be read"),
    "garbage": (text_with(-3, "zero " + "0 " * 16), "cannot be read"),
    "no text": (text_with(-2, "\xff\xfe" + "0 " * 18), "cannot be read"),
    "an empty line": (text_with(-2, ""), "empty line"),
    "not even a line": (plys.header(FLOATS, 3, "ascii") + b"7" * 300_000, "cannot be read|truncated"),
    "numbers beyond their type": (
        plys.header([*FLOATS[:-1], "uchar rot_3"], 1, "ascii") + b"0 " * 16 + b"300\n",
        "cannot be read",
    ),
}


@pytest.mark.parametrize(("content", "words"), HEADER.values(), ids=HEADER)
def test_a_broken_header_is_refused_before_anything_is_allocated(tmp_path: Path, content: bytes, words: str) -> None:
    path = plys.write(tmp_path / "scene.ply", content)
    tracemalloc.start()
    with pytest.raises(BrokenScene, match=words) as failure:
        read_header(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000
    assert_sentence(failure.value.detail)
    with pytest.raises(BrokenScene, match=words):
        load_ply(path)


@pytest.mark.parametrize(("content", "words"), DATA.values(), ids=DATA)
def test_broken_text_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = plys.write(tmp_path / "scene.ply", content)
    with pytest.raises(BrokenScene, match=words) as failure:
        load_ply(path)
    assert_sentence(failure.value.detail)


def test_a_missing_file_and_a_directory_are_broken(tmp_path: Path) -> None:
    with pytest.raises(BrokenScene, match=r"nowhere\.ply cannot be read: No such file"):
        read_header(tmp_path / "nowhere.ply")
    with pytest.raises(BrokenScene, match="cannot be read"):
        read_header(tmp_path)


def assert_sentence(detail: str) -> None:
    assert detail.startswith("scene.ply ")
    assert detail.endswith(".")
    assert "\n" not in detail
    assert len(detail) < 250
