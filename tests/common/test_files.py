"""Only files are read: what waits for a writer, or never ends, is refused at once."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from tests.not_files import NOT_FILES
from tigas_common.files import open_regular, read_regular


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
