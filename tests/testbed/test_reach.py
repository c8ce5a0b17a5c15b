"""Root's private directories, from a service's point of view."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tigas_common.errors import StartError
from tigas_testbed.reach import own_code, reaching
from tigas_testbed.user import User

ALICE = User(1234, 1234)


def seen_by_alice(argv: list[str], needed: list[Path], devices: list[Path] = []) -> str:  # noqa: B006
    """A command's output as another user, with separate mounts."""
    command = reaching(ALICE, [*own_code(), *needed], devices, ALICE.command(argv))
    return subprocess.run(["unshare", "--mount", *command], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def private(tmp_path: Path) -> Path:
    """A directory of root's alone, with a scene and a secret."""
    place = tmp_path / "private"
    for name in ("models/garden", "secrets"):
        (place / name).mkdir(parents=True)
    (place / "models/garden/points").write_text("points")
    (place / "secrets/key").write_text("key")
    place.chmod(0o700)
    return place


def test_of_a_closed_directory_there_is_what_is_needed_and_nothing_else(private: Path) -> None:
    assert seen_by_alice(["cat", str(private / "models/garden/points")], [private / "models"]) == "points"
    assert seen_by_alice(["ls", str(private)], [private / "models"]) == "models\n"
    assert sorted(path.name for path in private.iterdir()) == ["models", "secrets"], "only she sees it so"


def test_what_everybody_may_enter_needs_no_mounts(private: Path) -> None:
    assert reaching(ALICE, [Path("/usr/bin")], [], ["true"]) == ["true"]


def test_this_python_runs_wherever_it_is_installed() -> None:
    assert seen_by_alice([sys.executable, "-c", "import os, tigas_testbed; print(os.getuid(), os.getcwd())"], []) == (
        f"{ALICE.uid} {Path.cwd()}\n"
    )


def test_a_directory_that_is_closed_itself_is_named(private: Path) -> None:
    with pytest.raises(StartError, match=f"may not enter {private}"):
        reaching(ALICE, [private], [], ["true"])


def test_a_device_of_root_s_can_be_used(tmp_path: Path) -> None:
    device = tmp_path / "null"
    os.mknod(device, 0o600 | stat.S_IFCHR, os.makedev(1, 3))
    tmp_path.chmod(0o755)
    write = ["sh", "-c", f"echo > {device} && stat -c %u {device}"]
    assert seen_by_alice(write, [tmp_path], [device]) == f"{ALICE.uid}\n"
    assert device.stat().st_uid == 0
