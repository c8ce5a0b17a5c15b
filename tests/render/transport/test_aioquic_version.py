"""Another aioquic than the one whose private names are used is refused, in a sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from tigas_common.errors import StartError
from tigas_render.transport import aioquic_version
from tigas_render.transport.aioquic_version import MINOR_VERSION, check_aioquic

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("installed", [MINOR_VERSION, f"{MINOR_VERSION}.0", f"{MINOR_VERSION}.12"])
def test_every_patch_of_the_minor_version_will_do(installed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aioquic_version, "version", lambda name: installed)
    check_aioquic()


@pytest.mark.parametrize("installed", ["1.6.9", "1.8.0", "1.70.1", "2.0", "0.1.7"])
def test_another_minor_version_is_refused(installed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aioquic_version, "version", lambda name: installed)
    with pytest.raises(StartError, match=rf"^aioquic {installed} is installed, but TIGAS needs {MINOR_VERSION}: .*\.$"):
        check_aioquic()


def test_the_same_version_is_asked_for_and_pinned() -> None:
    requirements = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["render"]
    assert f"aioquic=={MINOR_VERSION}.*" in requirements
    assert f"\naioquic=={MINOR_VERSION}." in (ROOT / "constraints.txt").read_text()
