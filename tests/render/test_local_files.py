"""This user's files: reproducible data is kept whole or not at all, and temporary directories do not stay."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from tigas_render.local_files import MIN_AGE_S, cache_directory, load_or_create_key, locked_directory, write_to_cache


def test_a_file_replaces_another_and_nothing_else_stays(tmp_path: Path) -> None:
    for content in (b"old", b"new"):
        write_to_cache(tmp_path / "made" / "kernels.cubin", content)
    assert {path.name: path.read_bytes() for path in (tmp_path / "made").iterdir()} == {"kernels.cubin": b"new"}


def test_a_cache_that_cannot_be_written_is_a_log_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    write_to_cache(tmp_path / "file" / "kernels.cubin", b"code")
    assert f"The cache {tmp_path / 'file'} cannot be written" in caplog.text


def test_a_file_that_cannot_take_its_place_leaves_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "kernels.cubin").mkdir()
    write_to_cache(tmp_path / "kernels.cubin", b"code")
    assert [path.name for path in tmp_path.iterdir()] == ["kernels.cubin"]
    assert "cannot be written" in caplog.text


def test_users_choose_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_directory() == Path("/somewhere/tigas")


def test_a_key_stays_the_same_and_is_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "cache" / "a.key"
    key = load_or_create_key(path)
    assert len(key) == 32
    assert load_or_create_key(path) == key
    assert path.stat().st_mode & 0o777 == 0o600
    assert load_or_create_key(tmp_path / "b.key") != key


@pytest.mark.parametrize("content", [b"", b"short", bytes(33)])
def test_a_broken_key_is_replaced_by_one_that_is_not_kept(content: bytes, tmp_path: Path) -> None:
    (path := tmp_path / "a.key").write_bytes(content)
    assert len({load_or_create_key(path), load_or_create_key(path)}) == 2


def test_a_key_that_cannot_be_kept_is_no_failure(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert len(load_or_create_key(tmp_path / "file" / "a.key")) == 32


PREFIX = "tigas-render-"


def age(path: Path, s: float = 2 * MIN_AGE_S) -> None:
    """Let a directory be so old that its service must have locked it."""
    then = time.time() - s
    os.utime(path, (then, then))


def test_it_is_for_nobody_else_and_gone_in_the_end(tmp_path: Path) -> None:
    with locked_directory(tmp_path, PREFIX) as directory:
        assert directory.stat().st_mode & 0o777 == 0o700
        (directory / "http.sock").touch()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("age_s", [2 * MIN_AGE_S, -3600.0], ids=["old", "made while the clock was ahead"])
def test_what_a_killed_service_has_left_is_removed(tmp_path: Path, age_s: float) -> None:
    left = tmp_path / f"{PREFIX}left"
    left.mkdir()
    (left / "http.sock").touch()
    age(left, age_s)
    with locked_directory(tmp_path, PREFIX) as directory:
        assert list(tmp_path.iterdir()) == [directory]


def test_what_runs_what_starts_and_what_is_not_a_services_stays(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    link = tmp_path / f"{PREFIX}link"
    starting = tmp_path / f"{PREFIX}starting"
    elsewhere.mkdir()
    age(elsewhere)
    link.symlink_to(elsewhere)
    starting.mkdir()
    with locked_directory(tmp_path, PREFIX) as running:
        (running / "http.sock").touch()
        age(running)
        with locked_directory(tmp_path, PREFIX) as another:
            assert set(tmp_path.iterdir()) == {elsewhere, link, starting, running, another}
            assert (running / "http.sock").exists()
