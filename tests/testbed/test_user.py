"""The user of the services, the ownership of its files, and root's private directories from its point of view."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tigas_common.errors import StartError
from tigas_common.files import NOBODY
from tigas_testbed.user import User, code_folders, grant_access

ALICE = User(1234, 1234)


@pytest.mark.parametrize(
    ("environment", "owner", "user"),
    [
        ({"SUDO_UID": "1234", "SUDO_GID": "1234"}, 0, ALICE),
        ({"SUDO_UID": "1234", "SUDO_GID": "1234"}, 77, ALICE),
        ({}, 1234, ALICE),
        ({"SUDO_UID": "0", "SUDO_GID": "0"}, 1234, ALICE),
        ({}, 0, User(NOBODY, NOBODY)),
    ],
    ids=["sudo", "sudo in another's directory", "root in a user's directory", "sudo by root", "root alone"],
)
def test_services_run_as_the_caller_and_never_as_root(
    tmp_path: Path, environment: dict[str, str], owner: int, user: User
) -> None:
    os.chown(tmp_path, owner, owner)
    assert User.service_user(environment, tmp_path) == user


def test_a_folder_is_given_with_what_root_and_nobody_left_in_it(tmp_path: Path) -> None:
    results, elsewhere = tmp_path / "results", tmp_path / "elsewhere"
    (results / "old/runs").mkdir(parents=True)
    (results / "old/link").symlink_to(elsewhere)
    elsewhere.touch()
    for name, owner in (("of-root", 0), ("of-nobody", NOBODY), ("of-bob", 99)):
        (results / "old" / name).touch()
        os.chown(results / "old" / name, owner, owner)
    ALICE.take_ownership(results)
    owners = {path.name: path.lstat().st_uid for path in (results, *results.rglob("*"))}
    assert owners.pop("of-bob") == 99
    assert set(owners.values()) == {ALICE.uid}
    assert elsewhere.stat().st_uid == 0, "a link is given, not what it leads to"


def test_a_file_that_has_another_name_stays_whose_it_is(tmp_path: Path) -> None:
    models, scene = tmp_path / "models", tmp_path / "garden.ply"
    models.mkdir()
    scene.touch()
    (models / "garden.ply").hardlink_to(scene)
    ALICE.take_ownership(models)
    assert (models.stat().st_uid, scene.stat().st_uid) == (ALICE.uid, 0)


def test_who_has_no_home_gets_one_that_they_may_write_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_testbed.user.CACHE", tmp_path)
    home = Path(ALICE.environment()["HOME"])
    assert home.parent == tmp_path
    assert (home.stat().st_uid, home.stat().st_mode & 0o777) == (ALICE.uid, 0o700)
    assert ALICE.environment()["HOME"] == str(home), "also the next time"


def test_a_command_has_neither_root_s_rights_nor_its_groups() -> None:
    run = subprocess.run(ALICE.command(["cat", "/proc/self/status"]), capture_output=True, text=True, check=True)
    status = dict(line.split(":\t", 1) for line in run.stdout.splitlines())
    assert (set(status["Uid"].split()), status["Groups"].split()) == ({"1234"}, [])
    assert {int(status[kind], 16) for kind in ("CapEff", "CapPrm", "CapBnd", "CapInh", "CapAmb")} == {0}


def seen_by_alice(argv: list[str], needed: list[Path], devices: list[Path] = []) -> str:  # noqa: B006
    """A command's output as another user, with separate mounts."""
    command = grant_access(ALICE, [*code_folders(), *needed], devices, ALICE.command(argv))
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


def test_this_python_runs_wherever_it_is_installed() -> None:
    assert seen_by_alice([sys.executable, "-c", "import os, tigas_testbed; print(os.getuid(), os.getcwd())"], []) == (
        f"{ALICE.uid} {Path.cwd()}\n"
    )


def test_only_closed_directories_need_mounts_and_one_that_is_closed_itself_is_named(private: Path) -> None:
    assert grant_access(ALICE, [Path("/usr/bin")], [], ["true"]) == ["true"]
    with pytest.raises(StartError, match=f"may not enter {private}"):
        grant_access(ALICE, [private], [], ["true"])


def test_a_device_of_root_s_can_be_used(tmp_path: Path) -> None:
    device = tmp_path / "null"
    os.mknod(device, 0o600 | stat.S_IFCHR, os.makedev(1, 3))
    tmp_path.chmod(0o755)
    write = ["sh", "-c", f"echo > {device} && stat -c %u {device}"]
    assert seen_by_alice(write, [tmp_path], [device]) == f"{ALICE.uid}\n"
    assert device.stat().st_uid == 0
