"""Any archive is unpacked whole into its own folder, or refused with no file left behind."""

from __future__ import annotations

import io
import stat
import tarfile
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.byte_edits import edited
from tests.fuzz.fuzzers import assert_sentence, effort, found
from tigas_common.downloads import FetchError
from tigas_common.errors import StartError
from tigas_experiments.report.archive import unpack as unpack_runs
from tigas_shaper.traces.fetch import unpack as unpack_traces

NAMES = (
    *("study/experiment.json", "study/runs/a/run.json", "study/runs", "study", "other/x", "study/../x", "../x", "/x"),
    *("..", ".", "", "/", "//", "study//x", "./study/x", "study/./x"),
    *("C:\\x", "\\x", "study\\x", "study/\udcff", "study/" + "x" * 300),
    *("study/a\nb\x1b[2J", "~/x", "study/CON", "study/x\0y", "outside", ".runs.tar.xz.part", "runs.tar.xz", "é/è"),
)  # fmt: skip
LINKS = (
    "/etc/passwd",
    "..",
    "../outside",
    "../../../../etc",
    "experiment.json",
    "study/experiment.json",
    "",
    ".",
    "x" * 300,
)
OUTSIDE = "outside"
"""A file next to the archive, which must stay untouched."""

KINDS = (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE, tarfile.CONTTYPE)
kinds = st.just(tarfile.REGTYPE) | st.just(tarfile.REGTYPE) | st.sampled_from(KINDS)
names, links, contents = st.sampled_from(NAMES), st.sampled_from(LINKS), st.binary(max_size=40)


@st.composite
def tars(draw: st.DrawFn) -> bytes:
    """A .tar.xz with entries of all kinds."""
    buffer = io.BytesIO()
    format = draw(st.sampled_from((tarfile.GNU_FORMAT, tarfile.PAX_FORMAT)))
    with tarfile.open(fileobj=buffer, mode="w:xz", format=format, preset=0) as tar:
        for _ in range(draw(st.integers(0, 5))):
            entry = tarfile.TarInfo(draw(st.sampled_from(NAMES[:2]) | names))
            entry.type, entry.linkname = draw(kinds), draw(links)
            entry.mode = draw(st.sampled_from((0o644, 0o4755, 0o000, 0o777)))
            entry.mtime = draw(st.sampled_from((0, 0, -1.5, 1e20)) if format == tarfile.PAX_FORMAT else st.just(0))
            content = draw(contents)
            entry.size = len(content) if entry.isreg() else 0
            tar.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


@st.composite
def zips(draw: st.DrawFn) -> bytes:
    """A .zip with entries of all kinds."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", draw(st.sampled_from((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))) as archive:
        for _ in range(draw(st.integers(0, 5))):
            entry = zipfile.ZipInfo(draw(names).encode("utf-8", "replace").decode().replace("\0", "") or "x")
            entry.external_attr = draw(st.sampled_from((0o644, stat.S_IFLNK | 0o777, stat.S_IFDIR | 0o755, 0))) << 16
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # two entries of one name
                archive.writestr(entry, draw(contents))
    return buffer.getvalue()


def unpacked(content: bytes, name: str, unpack: Callable[[Path], Path]) -> None:
    """Unpack an archive in a folder, and examine the changes there."""
    with tempfile.TemporaryDirectory() as parent:
        place = Path(parent, "here")
        place.mkdir()
        (place / OUTSIDE).write_text("mine")
        archive = place / name
        archive.write_bytes(content)
        before = {OUTSIDE, name}
        try:
            folder = unpack(archive)
        except (StartError, FetchError, OSError) as error:  # a file may be in place of a folder
            if not isinstance(error, OSError):
                assert_sentence(str(error))
            assert {path.name for path in place.iterdir()} == before, "something was left behind"
        else:
            assert folder.parent == place
            assert {path.name for path in place.iterdir()} == before | {folder.name}
            for path in folder.rglob("*"):
                assert path.resolve().is_relative_to(folder.resolve()), f"{path} leads outside"
                assert path.is_symlink() or path.is_file() or path.is_dir(), f"{path} is no file"
                assert not path.lstat().st_mode & (stat.S_ISUID | stat.S_ISGID)
        assert (place / OUTSIDE).read_text() == "mine"
        assert archive.read_bytes() == content
        assert [path.name for path in Path(parent).iterdir()] == ["here"]


@effort(150)
@given(content=tars() | edited(tars()))
@found("tar.xz", content=bytes)
def test_any_archive_of_runs_is_unpacked_or_refused(content: bytes) -> None:
    unpacked(content, "runs.tar.xz", unpack_runs)


@effort(150)
@given(content=zips() | edited(zips()))
@found("zip", content=bytes)
def test_any_zip_of_traces_is_unpacked_or_refused(content: bytes) -> None:
    unpacked(content, "traces.zip", unpack_traces)
