"""Only regular files are read, and writes and moves are atomic and durable."""

from __future__ import annotations

import errno
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.not_files import NOT_FILES
from tigas_common.files import NO_HARD_LINKS, move_new, open_regular, read_regular, replace_file


def test_a_file_is_read_also_through_a_link(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes(b"text")
    link.symlink_to(file)
    assert read_regular(link, 4) == b"text"
    with pytest.raises(OSError, match="too large"):
        read_regular(link, 3)


def test_a_small_file_takes_little_memory_whatever_the_limit(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"text")
    tracemalloc.start()
    try:
        read_regular(tmp_path / "file", 1_000_000_000)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", NOT_FILES)
def test_what_is_no_file_is_refused(tmp_path: Path, kind: str) -> None:
    NOT_FILES[kind](tmp_path / "made")
    with pytest.raises(OSError, match=r"."):
        open_regular(tmp_path / "made")


def refusing(number: int) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.fixture(params=[None, *sorted(NO_HARD_LINKS)])
def links(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """File systems with and without hard links."""
    if request.param is not None:
        monkeypatch.setattr(os, "link", refusing(request.param))


@pytest.mark.usefixtures("links")
def test_a_move_to_a_free_name(tmp_path: Path) -> None:
    (tmp_path / "part").write_bytes(b"new")
    (tmp_path / "link").symlink_to("nowhere")
    (tmp_path / "folder").mkdir()
    for name in ("part", "link", "folder"):
        move_new(tmp_path / name, tmp_path / f"{name} moved")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder moved", "link moved", "part moved"]
    assert (tmp_path / "part moved").read_bytes() == b"new"
    assert (tmp_path / "link moved").readlink() == Path("nowhere")


@pytest.mark.usefixtures("links")
def test_a_move_replaces_nothing(tmp_path: Path) -> None:
    (tmp_path / "part").write_bytes(b"new")
    (tmp_path / "taken").write_bytes(b"old")
    with pytest.raises(FileExistsError):
        move_new(tmp_path / "part", tmp_path / "taken")
    assert [(tmp_path / name).read_bytes() for name in ("part", "taken")] == [b"new", b"old"]


def test_a_failed_move_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "part").write_bytes(b"new")
    monkeypatch.setattr(os, "link", refusing(errno.EPERM))
    monkeypatch.setattr(Path, "replace", refusing(errno.EIO))
    with pytest.raises(OSError, match="Input/output"):
        move_new(tmp_path / "part", tmp_path / "scene")
    assert [path.name for path in tmp_path.iterdir()] == ["part"]


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    replace_file(file, b"old")
    replace_file(file, b"newer")
    monkeypatch.setattr(os, "fsync", refusing(errno.EIO))
    with pytest.raises(OSError, match="Input/output"):
        replace_file(file, b"newest")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"newer")]
