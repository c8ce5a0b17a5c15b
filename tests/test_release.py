"""The release works alone, and its dependencies are locked: by digest, from public indexes."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from zipfile import ZipFile

import pytest

from tigas_render.server.app import STATIC

ROOT = Path(__file__).parents[1]
PAGE = "tigas_render/static/index.html"
DEMO = {f"tigas_render/scenes/demo/{name}" for name in ("courtyard.sog", "scene.json", "ladder.json")}
Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A source archive, and the wheel that is made of it."""
    assert (STATIC / "index.html").is_file(), "the page is not built: cd web && npm run build"
    folder = tmp_path_factory.mktemp("dist")
    uv("build", "--no-build-isolation", "--python", sys.executable, "--out-dir", str(folder), str(ROOT))
    return folder


@pytest.fixture(scope="module")
def run(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs a program of a fresh environment with the wheel."""
    environment = tmp_path_factory.mktemp("fresh")
    wheel = next(built.glob("*.whl"))
    uv("venv", "--quiet", "--clear", "--python", sys.executable, str(environment))
    python = environment / "bin/python"
    pins = environment / "pins.txt"
    uv("export", "--frozen", "--quiet", "--no-default-groups", "--no-emit-project", "--no-hashes", "-o", str(pins))
    uv("pip", "install", "--quiet", "--python", str(python), "--constraint", str(pins), str(wheel))

    def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        argv = [str(environment / "bin" / program), *arguments]
        return subprocess.run(argv, cwd=environment, capture_output=True, text=True, timeout=60, check=False)

    return run


def uv(*arguments: str) -> str:
    argv = [sys.executable, "-m", "uv", *arguments]
    done = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_wheel_and_source_archive_have_the_page_and_the_demo_scene(built: Path) -> None:
    with ZipFile(next(built.glob("*.whl"))) as wheel:
        names = wheel.namelist()
    assert {PAGE, *DEMO, "tigas_render/static/viewer/index.js", "tigas/widget.js"} <= set(names)
    assert any(re.fullmatch(r"tigas_render/static/assets/.+\.js", name) for name in names)
    assert {"tigas/py.typed", "tigas_common/py.typed"} <= set(names)
    assert not [name for name in names if name.startswith(("tests/", "web/"))]
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        archived = {name.partition("/services/render/")[2] for name in archive.getnames()}
    assert {PAGE, *DEMO} <= archived


@pytest.mark.slow
def test_the_command_runs_from_the_wheel_alone(run: Run) -> None:
    assert run("tigas", "--version").stdout == f"tigas {version('tigas')}\n"
    said = run("tigas", "--help")
    assert said.returncode == 0, said.stderr
    assert {"render", "dash", "store", "experiment"} <= set(said.stdout.split())
    for command in ("render", "demo"):
        refused = run("tigas", command)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert re.fullmatch(r".* (is|are) not installed: pip install 'tigas\[.+\] @ file:.+\.whl'\n", refused.stderr)


@pytest.mark.slow
def test_the_client_runs_from_the_wheel_alone(run: Run) -> None:
    program = "import tigas\ntry: tigas.Client('http://127.0.0.1:9').scenes()\nexcept tigas.Unreachable as e: print(e)"
    said = run("python", "-W", "error", "-c", program)
    assert said.stdout.startswith("The render service at http://127.0.0.1:9 does not answer"), said.stderr


def test_there_is_an_sbom_of_what_each_image_installs() -> None:
    composed = "".join(path.read_text() for path in ROOT.glob("compose*.yaml"))
    installed = {extra for listed in re.findall(r'EXTRA: "?(\w+(?:,\w+)*)', composed) for extra in listed.split(",")}
    described = re.search(r"^SBOM_EXTRAS := (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert described
    assert set(described[1].split()) == installed


PACKAGES: list[dict[str, Any]] = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
DEPENDENCIES = [package for package in PACKAGES if package["name"] != "tigas"]
HOSTS = {"files.pythonhosted.org", "pypi.org"}


def test_the_lock_is_newer_than_the_project_file() -> None:
    uv("lock", "--offline", "--check")  # else `make lock`


def test_every_file_is_on_a_public_host_and_has_a_digest() -> None:
    assert len(DEPENDENCIES) > 100
    for package in DEPENDENCIES:
        files = [*package["wheels"], *([package["sdist"]] if "sdist" in package else [])]
        assert urlsplit(package["source"]["registry"]).hostname in HOSTS
        assert files, package["name"]
        assert {urlsplit(file["url"]).hostname for file in files} <= HOSTS
        assert all(file["hash"].startswith("sha256:") for file in files)


def test_the_demo_has_neither_pytorch_nor_scipy() -> None:
    extras = ("--extra", "render", "--extra", "dash", "--extra", "shaper")
    demo = uv("export", "--frozen", "--no-default-groups", "--no-emit-project", "--no-hashes", *extras)
    assert "numba==" in demo
    without = ("torch", "ray", "scipy", "matplotlib", "mypy", "nvidia-cublas")
    assert not [name for name in without if f"{name}==" in demo]


def test_what_builds_the_package_is_installed_from_the_lock() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert set(project["build-system"]["requires"]) <= set(project["dependency-groups"]["build"])
    assert project["tool"]["uv"]["no-build-isolation-package"] == ["tigas"]
