"""Missing packages are named with a command that installs them."""

from __future__ import annotations

import json
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tigas_common.errors import StartError
from tigas_common.extras import install_command, require


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
        "tigas_common.extras.distribution", lambda name: project if name == "tigas" else distribution(name)
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
