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
from tigas_common.installation import COMMIT_VARIABLE, check_versions, install_command, require_extras, this_commit

ROOT = Path(__file__).parents[2]


PACKAGES = ("aioice", "aioquic", "aiortc", "cuda-core", "uvicorn")
"""Those of which private names are used."""


def test_the_installed_versions_are_supported() -> None:
    check_versions(*PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_another_minor_version_is_refused_in_a_sentence(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pattern = re.compile(rf"{package}(?:\[\w+\])?>=(\d+)\.(\d+),<(\d+)\.(\d+)")
    required = {found.groups() for each in extras.values() for one in each if (found := pattern.fullmatch(one))}
    [(major, low, end_major, end)] = required
    assert major == end_major
    first, last = int(low), int(end) - 1
    for installed in (f"{major}.{first}", f"{major}.{first}.12", f"{major}.{last}.9"):
        monkeypatch.setattr(installation, "version", lambda name, installed=installed: installed)
        check_versions(package)
    wrong = (f"{major}.{first - 1}.9", f"{major}.{end}.0", f"{major}.{end}0.1", f"{int(major) + 1}.0", f"0.0.{first}")
    for installed in wrong:
        monkeypatch.setattr(installation, "version", lambda name, installed=installed: installed)
        needed = f"{package}>={major}.{first},<{major}.{end}"
        with pytest.raises(StartError) as refused:
            check_versions(package)
        assert str(refused.value) == (
            f"{package} {installed} is installed, but TIGAS needs {needed}: pip install '{needed}'."
        )


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


def test_in_the_environment_of_the_makefile_make_installs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    installed(monkeypatch, Installed(tmp_path.as_uri(), dir_info={"editable": True}))
    assert install_command("lab") == f"pip install -e '{tmp_path}[lab]'"
    monkeypatch.setattr("sys.prefix", str(tmp_path / ".venv"))
    assert install_command("lab") == f"make -C {tmp_path} lab"
    assert install_command("cluster") == f"pip install -e '{tmp_path}[cluster]'"


def test_all_packages_that_are_missing_are_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    installed(monkeypatch, Installed())
    require_extras("render")
    with pytest.raises(StartError, match=r"^no-such is not installed: pip install 'tigas\[dash\]'$"):
        require_extras("dash")
