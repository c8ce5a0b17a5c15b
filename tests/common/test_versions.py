"""Packages with private uses: unsupported versions are refused in a sentence."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from tigas_common import versions
from tigas_common.errors import StartError
from tigas_common.versions import SUPPORTED, check_versions

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
    monkeypatch.setattr(versions, "version", lambda name: installed)
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
    monkeypatch.setattr(versions, "version", lambda name: installed)
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
    monkeypatch.setattr(versions, "version", lambda name: pinned)
    check_versions(package)
