"""Temporary directories, and leftovers of killed processes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from tigas_render.local_files import YOUNG_S, locked_directory

PREFIX = "tigas-render-"


@pytest.fixture
def temporary(tmp_path: Path) -> Path:
    """Where temporary files are."""
    return tmp_path


def age(path: Path, s: float = 2 * YOUNG_S) -> None:
    """Let a directory be so old that its service must have locked it."""
    then = time.time() - s
    os.utime(path, (then, then))


def test_it_is_for_nobody_else_and_gone_in_the_end(temporary: Path) -> None:
    with locked_directory(temporary, PREFIX) as directory:
        assert directory.stat().st_mode & 0o777 == 0o700
        (directory / "http.sock").touch()
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("age_s", [2 * YOUNG_S, -3600.0], ids=["old", "made while the clock was ahead"])
def test_what_a_killed_service_has_left_is_removed(temporary: Path, age_s: float) -> None:
    left = temporary / f"{PREFIX}left"
    left.mkdir()
    (left / "http.sock").touch()
    age(left, age_s)
    with locked_directory(temporary, PREFIX) as directory:
        assert list(temporary.iterdir()) == [directory]


def test_what_runs_what_starts_and_what_is_not_a_services_stays(temporary: Path) -> None:
    elsewhere = temporary / "elsewhere"
    link = temporary / f"{PREFIX}link"
    starting = temporary / f"{PREFIX}starting"
    elsewhere.mkdir()
    age(elsewhere)
    link.symlink_to(elsewhere)
    starting.mkdir()
    with locked_directory(temporary, PREFIX) as running:
        (running / "http.sock").touch()
        age(running)
        with locked_directory(temporary, PREFIX) as another:
            assert set(temporary.iterdir()) == {elsewhere, link, starting, running, another}
            assert (running / "http.sock").exists()
