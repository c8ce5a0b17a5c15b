"""uv.lock fits pyproject.toml, names public indexes only, and has a digest for every file."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

ROOT = Path(__file__).parents[1]
PACKAGES: list[dict[str, Any]] = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
DEPENDENCIES = [package for package in PACKAGES if package["name"] != "tigas"]
HOSTS = {"files.pythonhosted.org", "pypi.org"}


def exported(*options: str) -> str:
    argv = [sys.executable, "-m", "uv", "export", "--frozen", "--quiet", "--no-emit-project", "--no-hashes", *options]
    return subprocess.run(argv, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def test_the_lock_is_newer_than_the_project_file() -> None:
    argv = [sys.executable, "-m", "uv", "lock", "--offline", "--check"]
    checked = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, f"pyproject.toml has changed: make lock ({checked.stderr})"


def test_every_file_is_on_a_public_host_and_has_a_digest() -> None:
    assert len(DEPENDENCIES) > 100
    for package in DEPENDENCIES:
        files = [*package["wheels"], *([package["sdist"]] if "sdist" in package else [])]
        assert urlsplit(package["source"]["registry"]).hostname in HOSTS
        assert files, package["name"]
        assert {urlsplit(file["url"]).hostname for file in files} <= HOSTS
        assert all(file["hash"].startswith("sha256:") for file in files)


def test_the_demo_has_neither_pytorch_nor_scipy() -> None:
    demo = exported("--no-default-groups", "--extra", "render", "--extra", "dash", "--extra", "shaper")
    assert "numba==" in demo
    without = ("torch", "ray", "scipy", "matplotlib", "mypy", "nvidia-cublas")
    assert not [name for name in without if f"{name}==" in demo]


def test_what_builds_the_package_is_installed_from_the_lock() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert set(project["build-system"]["requires"]) <= set(project["dependency-groups"]["build"])
    assert project["tool"]["uv"]["no-build-isolation-package"] == ["tigas"]
