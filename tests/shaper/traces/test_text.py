"""Binary or oversized input is refused before parsing."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from tests.shaper.traces.recordings import GHENT, read
from tigas_shaper.traces import text as text_module
from tigas_shaper.traces.formats import load_trace
from tigas_shaper.traces.trace import TraceError


def test_gzip_is_read_like_the_text_in_it() -> None:
    assert read(gzip.compress(GHENT.encode())) == read(GHENT)
    assert read(b"\xef\xbb\xbf" + GHENT.encode()) == read(GHENT)


def test_a_gzip_bomb_costs_no_more_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_module, "MAX_BYTES", 1_000_000)
    bomb = gzip.compress(b"5000\n" * 10_000_000)  # 50 MB from 50 kB
    unpacked: list[int] = []
    original = gzip.GzipFile.read

    def counting(self: gzip.GzipFile, size: int | None = -1) -> bytes:
        data: bytes = original(self, size)
        unpacked.append(len(data))
        return data

    monkeypatch.setattr(gzip.GzipFile, "read", counting)
    with pytest.raises(TraceError, match="larger than 1 MB"):
        read(bomb)
    assert unpacked == [1_000_001]


def test_a_huge_file_is_refused_without_reading_it_whole(tmp_path: Path) -> None:
    huge = tmp_path / "huge.csv"
    with huge.open("wb") as file:
        file.truncate(1 << 30)  # sparse
    with pytest.raises(TraceError, match="larger than 64 MB"):
        load_trace(huge)
