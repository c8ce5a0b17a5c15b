"""Malformed files: one sentence each, and no memory by their announced sizes."""

from __future__ import annotations

import gzip
import io
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from PIL import Image

from tests.fuzz.fuzzers import assert_sentence
from tests.render.scenes import made_up, plys
from tests.render.scenes.test_formats import splat_bytes, spz_bytes
from tigas_common.errors import BrokenScene
from tigas_render.scenes.directory import read_scene_file
from tigas_render.scenes.ply import MAX_HEADER

GOOD, TEXT = plys.binary_ply(), plys.ascii_ply()
FLOATS = plys.names(0)


def text_with(line: int, new: str) -> bytes:
    lines = TEXT.decode().splitlines()
    lines[line] = new
    return "\n".join(lines).encode() + b"\n"


def without(*gone: str) -> bytes:
    kept = [name for name in FLOATS if name not in gone]
    return plys.header(kept, 1) + bytes(4 * len(kept))


SHELL = made_up.shell()
COMPRESSED, SPZ_3, SPZ_4, SOG = (
    (made_up.FILES / f"shell{end}").read_bytes() for end in (".compressed.ply", "-3.spz", "-4.spz", ".sog")
)
SPLAT = splat_bytes(made_up.shell(0))
HUGE = 2**31


def spz(**header: int) -> bytes:
    return gzip.compress(spz_bytes(SHELL, **header))


def spz_4(**changes: int) -> bytes:
    """With other values in its header, each at its byte: `count`, `streams`, `table`, or the first stream's sizes."""
    places = {"version": 4, "count": 8, "table": 16, "packed": 32, "unpacked": 40}
    content = bytearray(SPZ_4)
    for name, value in changes.items():
        if name == "streams":
            content[15] = value
        else:
            struct.pack_into("<Q" if name in ("packed", "unpacked") else "<I", content, places[name], value)
    return bytes(content)


def webp(width: int, height: int) -> bytes:
    file = io.BytesIO()
    Image.new("RGBA", (width, height)).save(file, "WEBP", lossless=True)
    return file.getvalue()


def sog(change: Callable[[dict[str, Any]], object] | None = None, compression: int = 0, **files: bytes | None) -> bytes:
    """The bundle with a changed meta.json, or with other files, by their names' first parts; None leaves one out."""
    with zipfile.ZipFile(io.BytesIO(SOG)) as bundle:
        content: dict[str, bytes | None] = {name: bundle.read(name) for name in bundle.namelist()}
    meta = json.loads(content["meta.json"] or b"")
    if change is not None:
        change(meta)
    content["meta.json"] = json.dumps(meta).encode()
    content |= {"meta.json" if name == "meta" else f"{name}.webp": data for name, data in files.items()}
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as made:
        for name, data in content.items():
            if data is not None:
                made.writestr(name, data)
    return file.getvalue()


def with_many_files() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as made:
        for number in range(2000):
            made.writestr(f"{number:04}", b"")
    return file.getvalue()


HEADER = {
    "PLY: empty": (b"", "is empty"),
    "PLY: ply in its name only": (b"plywood\n", "does not begin with 'ply'"),
    "PLY: cut in the header": (GOOD[:60], "truncated: its header has no 'end_header'"),
    "PLY: oversized header": (b"ply\n" + b"comment x\n" * (MAX_HEADER // 8), "header of more than 64 KiB"),
    "PLY: header without line ends": (b"ply\n" + b"x" * 200_000, "header of more than 64 KiB"),
    "PLY: cut in the data": (GOOD[:-1], "truncated: 3 vertices make"),
    "PLY: cut before the data": (plys.header(FLOATS, 3), "truncated: 3 vertices make"),
    "PLY: bytes left over": (GOOD + b"\0", "longer than its header says"),
    "PLY: 10¹² vertices": (plys.header(FLOATS, 10**12) + bytes(68), "1000000000000 vertices make 68000000000423 bytes"),
    "PLY: 10¹² vertices as text": (
        plys.header(FLOATS, 10**12, "ascii") + b"0 " * 34,
        "1000000000000 vertices make at least",
    ),
    "PLY: 10³⁰ vertices": (plys.header(FLOATS, 10**30) + bytes(68), "impossible number"),
    "PLY: 10⁵⁰⁰⁰ vertices": (plys.header(FLOATS, 3).replace(b"x 3", b"x " + b"9" * 5000), "impossible number"),
    "PLY: negative count": (plys.header(FLOATS, -1), "broken PLY header"),
    "PLY: no count": (GOOD.replace(b"element vertex 3", b"element vertex"), "broken PLY header"),
    "PLY: an underscore in the count": (
        plys.header(FLOATS, 3).replace(b"x 3", b"x 0_0"),
        "line 3 is not 'element', a name",
    ),
    "PLY: a sign before the count": (
        plys.header(FLOATS, 3).replace(b"x 3", b"x +0"),
        "line 3 is not 'element', a name",
    ),
    "PLY: a sign before 10¹²": (plys.header(FLOATS, 3).replace(b"x 3", b"x +1000000000000"), "line 3 is not 'element'"),
    "PLY: a vertical tab": (GOOD.replace(b"element vertex", b"element\x0bvertex"), "line 3 is not plain ASCII text"),
    "PLY: a carriage return": (GOOD.replace(b"element vertex", b"element\rvertex"), "line 3 is not plain ASCII text"),
    "PLY: a tab": (GOOD.replace(b"element vertex", b"element\tvertex"), "line 3 is not plain ASCII text"),
    "PLY: a line with an indent": (
        GOOD.replace(b"element vertex", b" element vertex"),
        "line 3 is not plain ASCII text",
    ),
    "PLY: zero vertices": (plys.header(FLOATS, 0), "0 vertices"),
    "PLY: no vertices": (GOOD.replace(b"element vertex", b"element points"), "no element 'vertex'"),
    "PLY: two vertex elements": (
        GOOD.replace(b"end_header", b"element vertex 1\nproperty float x\nend_header"),
        "same name",
    ),
    "PLY: big-endian": (GOOD.replace(b"little", b"big"), "big-endian"),
    "PLY: unknown format": (GOOD.replace(b"binary_little_endian", b"morse"), "broken PLY header"),
    "PLY: unknown type": (GOOD.replace(b"property float y", b"property quad y"), "broken PLY header"),
    "PLY: not ASCII": (GOOD.replace(b"element", b"element \xff\xfe 1\nelement", 1), "broken PLY header"),
    "PLY: property twice": (GOOD.replace(b"property float nx", b"property float x"), "same name"),
    "PLY: first missing property": (without("f_dc_1", "rot_2"), "no property 'f_dc_1'"),
    "PLY: a mesh": (plys.header(["x", "y", "z", "uchar red"], 1) + bytes(13), "no property 'f_dc_0'"),
    "PLY: a list": (GOOD.replace(b"property float nx", b"property list uchar float nx"), "a list as property 'nx'"),
    "PLY: lists before the vertices": (
        GOOD.replace(b"element vertex", b"element face 1\nproperty list uchar int v\nelement vertex"),
        "lists in element 'face' before",
    ),
    "PLY: 8 f_rest": (
        plys.header([*FLOATS, *(f"f_rest_{i}" for i in range(8))], 1) + bytes(100),
        "8 properties f_rest_*",
    ),
    "PLY: f_rest with a gap": (
        plys.header([*FLOATS, *(f"f_rest_{i}" for i in (*range(8), 9))], 1) + bytes(104),
        "no 'f_rest_8'",
    ),
    "SPZ, cut off": (SPZ_3[:12], "is damaged|is truncated"),
    "SPZ, gzip of something else": (gzip.compress(bytes(100)), "is not SPZ"),
    "SPZ, gzip with a name that never ends": (b"\x1f\x8b\x08\x08" + bytes(6) + b"x" * 3_000_000, "has no end"),
    "SPZ of a version to come": (spz(version=7), "has version 7 of SPZ"),
    "SPZ 4 in gzip": (spz(version=4), "has version 4 of SPZ"),
    "SPZ without Gaussians": (spz(count=0), "has 0 Gaussians"),
    "SPZ with 2³¹ Gaussians": (spz(count=HUGE), "promises 2147483648 Gaussians in"),
    "SPZ of degree 4": (spz(degree=4), "SH degree 4; 0 to 3"),
    "SPZ with 200 fractional bits": (spz(bits=200), "has 200 fractional bits"),
    "SPZ with extensions": (spz(flags=2), "has extensions"),
    "SPZ 4 with 2³¹ Gaussians": (spz_4(count=HUGE), "promises 2147483648 Gaussians in"),
    "SPZ 4 with a stream too many": (spz_4(streams=7), "has 7 streams where 6 belong"),
    "SPZ 4 with its table beyond its end": (spz_4(table=HUGE), "is truncated"),
    "SPZ 4 with a stream beyond its end": (spz_4(packed=2**63), "is truncated: its streams end at"),
    "SPZ 4 with a stream of 2⁶³ bytes": (spz_4(unpacked=2**63), "a stream of 9223372036854775808 bytes where 2700"),
    "SOG, cut off": (SOG[:-30], "truncated zip"),
    "SOG, an empty zip": (b"PK\x03\x04" + bytes(100), "truncated zip"),
    "SOG with 2,000 files": (with_many_files(), "a zip of too many files"),
    "SOG packed otherwise": (sog(compression=zipfile.ZIP_BZIP2), "neither stored nor deflated"),
    "SOG without a meta.json": (sog(meta=None), "has no meta.json in it"),
    "SOG with a meta.json of 1 MiB": (sog(lambda meta: meta.update(x="x" * 2**20), zipfile.ZIP_DEFLATED), "is larger"),
    "SOG with a meta.json that is none": (sog(meta=b"[" * 10_000), "meta.json that is not one of SOG"),
    "SOG, version 1": (sog(lambda meta: meta.pop("version")), "not one of SOG, version 2: version: field required"),
    "SOG with 2³¹ Gaussians": (sog(lambda meta: meta.update(count=HUGE)), "count: input should be less than or equal"),
    "SOG with 10⁷ Gaussians": (sog(lambda meta: meta.update(count=10**7)), "promises 10000000 Gaussians in"),
    "SOG with NaN in its ranges": (sog(lambda meta: meta["means"].update(mins=[float("nan")] * 3)), "finite number"),
    "SOG with half a codebook": (sog(lambda meta: meta["scales"].update(codebook=[0.0] * 128)), "at least 256"),
    "SOG with a path": (sog(lambda meta: meta["quats"].update(files=["../../etc/passwd"])), "not a plain name"),
    "SOG with an absolute path": (sog(lambda meta: meta["quats"].update(files=["/etc/passwd"])), "not a plain name"),
    "compressed PLY, cut off": (COMPRESSED[:-1], "truncated: 300 vertices make"),
    "compressed PLY with bytes left over": (COMPRESSED + b"\0", "longer than its header says"),
    "compressed PLY with 10¹² vertices": (
        COMPRESSED.replace(b"vertex 300", b"vertex 1000000000000"),
        "has 2 chunks of 256 for 1000000000000 vertices",
    ),
    "compressed PLY without chunks": (COMPRESSED.replace(b"element chunk", b"element lump"), "no element 'chunk'"),
    "compressed PLY of floats": (
        COMPRESSED.replace(b"property uint packed_scale", b"property float packed_scale"),
        "no property 'packed_scale' of the right type",
    ),
    "compressed PLY with few coefficients": (
        COMPRESSED.replace(b"property uchar f_rest_8\n", b""),
        "has 300 × 8 coefficients",
    ),
    ".splat, cut off": (SPLAT[:-1], "neither PLY, SPZ, SOG nor"),
}

DATA = {
    "PLY: too few rows": (TEXT.rsplit(b"\n", 2)[0] + b"\n", "promises 3 vertices and has 2"),
    "PLY: too few columns": (text_with(-2, "1 2 3 " + "4" * 400), "cannot be read"),
    "PLY: too many columns": (text_with(-1, "0 " * 18), "cannot be read"),
    "PLY: garbage": (text_with(-3, "zero " + "0 " * 16), "cannot be read"),
    "PLY: no text": (text_with(-2, "\xff\xfe" + "0 " * 18), "cannot be read"),
    "PLY: an empty line": (text_with(-2, ""), "empty line"),
    "PLY: not even a line": (plys.header(FLOATS, 3, "ascii") + b"7" * 300_000, "cannot be read|truncated"),
    "PLY: numbers beyond their type": (
        plys.header([*FLOATS[:-1], "uchar rot_3"], 1, "ascii") + b"0 " * 16 + b"300\n",
        "cannot be read",
    ),
    "SPZ, cut off in its data": (SPZ_3[:-200], "is damaged"),
    "SPZ with a Gaussian too few": (spz(count=301), "is truncated: it ends before all of its Gaussians"),
    "SPZ 4 with a damaged stream": (SPZ_4[:140] + bytes(60) + SPZ_4[200:], "is damaged"),
    "SPZ 4 that unpacks to too little": (
        spz_4(packed=len(zstandard.compress(bytes(9))))[:128] + zstandard.compress(bytes(9)) + SPZ_4[150:],
        "is truncated: it ends|is damaged",
    ),
    "SOG whose beginning is missing": (b"PK\x03\x04" + SOG[200:], r"a means_l\.webp that cannot be read"),
    "SOG without an image": (sog(quats=None), r"has no quats\.webp in it"),
    "SOG with an image that is none": (sog(quats=b"GIF89a" + bytes(100)), r"quats\.webp is not a lossless WebP"),
    "SOG with a lossy image": (sog(scales=b"RIFF\0\0\0\0WEBPVP8 " + bytes(90)), r"scales\.webp is not a lossless WebP"),
    "SOG with a small image": (sog(means_l=webp(4, 4)), r"means_l\.webp has 4 × 4 pixels, which does not fit"),
    "SOG with a huge image": (sog(means_u=webp(4000, 4000)), "has 4000 × 4000 pixels, which does not fit"),
    "SOG with a damaged image": (sog(sh0=webp(20, 20)[:26] + bytes(10)), r"sh0\.webp cannot be decoded|does not fit"),
    "SOG with a narrow palette": (sog(shN_centroids=webp(64, 16)), r"shN_centroids\.webp has 64 × 16 pixels"),
    "SOG with labels beyond the palette": (sog(lambda meta: meta["shN"].update(count=2)), "of a palette of 2"),
    "a bomb in SOG": (sog(compression=zipfile.ZIP_DEFLATED, quats=bytes(50_000_000)), r"quats\.webp is larger than"),
}


@pytest.mark.parametrize(("content", "words"), HEADER.values(), ids=HEADER)
def test_a_broken_header_is_refused_before_anything_is_allocated(tmp_path: Path, content: bytes, words: str) -> None:
    path = plys.write(tmp_path / "scene.bin", content)
    tracemalloc.start()
    with pytest.raises(BrokenScene, match=words) as failure:
        read_scene_file(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3_000_000
    assert_sentence(failure.value.detail)


@pytest.mark.parametrize(("content", "words"), DATA.values(), ids=DATA)
def test_broken_data_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = plys.write(tmp_path / "scene.bin", content)
    read_scene_file(path)  # listing a scene decodes nothing
    with pytest.raises(BrokenScene, match=words) as failure:
        read_scene_file(path).load()
    assert_sentence(failure.value.detail)


@pytest.mark.parametrize("kind", ["SPZ 3", "SPZ 4"])
def test_a_bomb_is_unpacked_no_further_than_its_header_says(tmp_path: Path, kind: str) -> None:
    zeros = bytes(30_000_000)
    if kind == "SPZ 3":
        content = gzip.compress(gzip.decompress(SPZ_3) + zeros)
    else:
        starts = struct.unpack_from("<QQ", SPZ_4, 32)[0]
        content = spz_4(packed=len(bomb := zstandard.compress(positions() + zeros)))
        content = content[:128] + bomb + SPZ_4[128 + starts :]
    path = plys.write(tmp_path / "scene.spz", content)
    tracemalloc.start()
    assert len(read_scene_file(path).load()) == made_up.COUNT
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3_000_000


def positions() -> bytes:
    """The first column of the made-up scene, in all versions."""
    return gzip.decompress(SPZ_3)[16 : 16 + 9 * made_up.COUNT]


def test_a_missing_file_is_broken(tmp_path: Path) -> None:
    with pytest.raises(BrokenScene, match=r"^nowhere\.ply cannot be read: No such file or directory\.$"):
        read_scene_file(tmp_path / "nowhere.ply")


def test_numbers_that_are_none_drop_their_gaussians(tmp_path: Path) -> None:
    content = bytearray(SPLAT)
    content[0:4] = content[44:48] = struct.pack("<f", np.nan)
    content[64 + 28 : 64 + 32] = bytes([128] * 4)  # a rotation of length zero
    assert len(read_scene_file(plys.write(tmp_path / "scene.splat", bytes(content))).load()) == made_up.COUNT - 3
    at = COMPRESSED.index(b"end_header\n") + len(b"end_header\n")
    ranges = COMPRESSED[:at] + np.full(3, np.nan, "<f4").tobytes() + COMPRESSED[at + 12 :]
    assert len(read_scene_file(plys.write(tmp_path / "scene.ply", ranges)).load()) == made_up.COUNT - 256, (
        "those of the chunk"
    )


def test_a_folder_reads_no_file_but_those_beside_its_meta_json(tmp_path: Path) -> None:
    path = made_up.unzip(tmp_path / "scene") / "meta.json"
    path.with_name("quats.webp").rename(tmp_path / "quats.webp")
    path.write_text(path.read_text().replace('"quats.webp"', '"../quats.webp"'))
    with pytest.raises(BrokenScene, match="not a plain name of a file"):
        read_scene_file(path)
