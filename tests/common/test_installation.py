"""The installation: its commit, its extras, and the versions that it supports."""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tigas_common import installation
from tigas_common.errors import StartError
from tigas_common.installation import COMMIT_VARIABLE, SUPPORTED, check_versions, install_command, require, this_commit

ROOT = Path(__file__).parents[2]


def test_the_installed_versions_are_supported() -> None:
    check_versions(*SUPPORTED)


@pytest.mark.parametrize(
    ("package", "installed"),
    [("aioquic", "1.7"), ("aioquic", "1.7.12"), ("uvicorn", "0.35.0"), ("uvicorn", "0.54.9"), ("cuda-core", "1.2.0")],
)
def test_every_patch_of_a_supported_minor_version_will_do(
    package: str, installed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "version", lambda name: installed)
    check_versions(package)


@pytest.mark.parametrize(
    ("package", "installed"),
    [
        ("aioquic", "1.6.9"),
        ("aioquic", "1.8.0"),
        ("aioquic", "1.70.1"),
        ("aioquic", "2.0"),
        ("aioquic", "0.1.7"),
        ("uvicorn", "0.34.3"),
        ("uvicorn", "0.55.0"),
        ("uvicorn", "1.0"),
        ("cuda-core", "1.3.0"),
        ("aiortc", "1.17.0"),
        ("aioice", "0.12.1"),
    ],
)
def test_another_minor_version_is_refused_in_a_sentence(
    package: str, installed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "version", lambda name: installed)
    first, end = SUPPORTED[package]
    needed = f"{package}>={first},<{end}"
    with pytest.raises(StartError) as refused:
        check_versions(package)
    assert str(refused.value) == (
        f"{package} {installed} is installed, but TIGAS needs {needed}: pip install '{needed}'."
    )


@pytest.mark.parametrize("package", SUPPORTED)
def test_the_same_versions_are_required_and_pinned(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    first, end = SUPPORTED[package]
    required = {
        found[1]
        for requirements in extras.values()
        for each in requirements
        if (found := re.fullmatch(rf"{package}(?:\[\w+\])?([<>=].*)", each))
    }
    assert required == {f">={first},<{end}"}
    locked = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    [pinned] = [each["version"] for each in locked if each["name"] == package]
    monkeypatch.setattr(installation, "version", lambda name: pinned)
    check_versions(package)


def test_the_working_tree_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(COMMIT_VARIABLE, raising=False)
    told = this_commit()
    assert told is None or re.fullmatch(r"[0-9a-f]{12}(-dirty)?", told)
    monkeypatch.setenv("PATH", "")
    assert this_commit() is None, "without git nobody knows"


def test_an_image_says_it_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(COMMIT_VARIABLE, "abc")
    assert this_commit() == "abc"
    monkeypatch.setenv(COMMIT_VARIABLE, "")  # built without it
    monkeypatch.setenv("PATH", "")
    assert this_commit() is None


class Installed:
    """The project's metadata, as installed from some place."""

    def __init__(self, url: str | None = None, **more: object) -> None:
        self.origin = None if url is None else json.dumps({"url": url, **more})
        self.requires = ["pydantic>=2", "no-such>=1; extra == 'dash'", "pytest>=1; extra == 'dash'"]

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return self.origin


def installed(monkeypatch: pytest.MonkeyPatch, project: Installed) -> None:
    monkeypatch.setattr(
        "tigas_common.installation.distribution", lambda name: project if name == "tigas" else distribution(name)
    )


def test_the_command_installs_from_where_tigas_came_from(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    commands = {
        Installed(): "pip install 'tigas[dash,render]'",
        Installed(tmp_path.as_uri(), dir_info={"editable": True}): f"pip install -e '{tmp_path}[dash,render]'",
        Installed(tmp_path.as_uri(), dir_info={}): f"pip install 'tigas[dash,render] @ {tmp_path.as_uri()}'",
        Installed("file:///no/such.whl", archive_info={}): "pip install 'tigas[dash,render]'",
        Installed("https://example.org/tigas.git", vcs_info={"vcs": "git", "commit_id": "abc"}): (
            "pip install 'tigas[dash,render] @ git+https://example.org/tigas.git@abc'"
        ),
    }
    for project, command in commands.items():
        installed(monkeypatch, project)
        assert install_command("dash", "render") == command


def test_all_packages_that_are_missing_are_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, Installed())
    require("render")
    with pytest.raises(StartError, match=r"^no-such is not installed: pip install 'tigas\[dash\]'$"):
        require("dash")
