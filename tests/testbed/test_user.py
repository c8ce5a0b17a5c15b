"""The user of the services, and the ownership of its files."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tigas_testbed.user import NOBODY, User

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
    assert User.of_services(environment, tmp_path) == user


def test_a_folder_is_given_with_what_root_and_nobody_left_in_it(tmp_path: Path) -> None:
    results, elsewhere = tmp_path / "results", tmp_path / "elsewhere"
    (results / "old/runs").mkdir(parents=True)
    (results / "old/link").symlink_to(elsewhere)
    elsewhere.touch()
    for name, owner in (("of-root", 0), ("of-nobody", NOBODY), ("of-bob", 99)):
        (results / "old" / name).touch()
        os.chown(results / "old" / name, owner, owner)
    ALICE.give(results)
    owners = {path.name: path.lstat().st_uid for path in (results, *results.rglob("*"))}
    assert owners.pop("of-bob") == 99
    assert set(owners.values()) == {ALICE.uid}
    assert elsewhere.stat().st_uid == 0, "a link is given, not what it leads to"


def test_a_file_that_has_another_name_stays_whose_it_is(tmp_path: Path) -> None:
    models, scene = tmp_path / "models", tmp_path / "garden.ply"
    models.mkdir()
    scene.touch()
    (models / "garden.ply").hardlink_to(scene)
    ALICE.give(models)
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
