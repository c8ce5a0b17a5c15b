"""A service's folder, and what is left of one whose processes were all killed."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import pytest

from tigas_render.fleet.directory import PREFIX, YOUNG_S, private_directory


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary files are."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def age(path: Path) -> None:
    """Let a directory be so old that its service must have locked it."""
    then = time.time() - 2 * YOUNG_S
    os.utime(path, (then, then))


def test_it_is_for_nobody_else_and_gone_in_the_end(temporary: Path) -> None:
    with private_directory() as directory:
        assert directory.stat().st_mode & 0o777 == 0o700
        (directory / "http.sock").touch()
    assert list(temporary.iterdir()) == []


def test_what_a_killed_service_has_left_is_removed(temporary: Path) -> None:
    left = temporary / f"{PREFIX}left"
    left.mkdir()
    (left / "http.sock").touch()
    age(left)
    with private_directory() as directory:
        assert list(temporary.iterdir()) == [directory]


def test_what_runs_what_starts_and_what_is_not_a_services_stays(temporary: Path) -> None:
    elsewhere = temporary / "elsewhere"
    link = temporary / f"{PREFIX}link"
    starting = temporary / f"{PREFIX}starting"
    elsewhere.mkdir()
    age(elsewhere)
    link.symlink_to(elsewhere)
    starting.mkdir()
    with private_directory() as running:
        (running / "http.sock").touch()
        age(running)
        with private_directory() as another:
            assert set(temporary.iterdir()) == {elsewhere, link, starting, running, another}
            assert (running / "http.sock").exists()
