"""The release works alone: a fresh environment with the wheel and no other file of ours."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
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


def uv(*arguments: str) -> None:
    argv = [sys.executable, "-m", "uv", *arguments]
    done = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_wheel_and_source_archive_have_the_page_and_the_demo_scene(built: Path) -> None:
    with ZipFile(next(built.glob("*.whl"))) as wheel:
        names = wheel.namelist()
    assert {PAGE, *DEMO} <= set(names)
    assert any(re.fullmatch(r"tigas_render/static/assets/.+\.js", name) for name in names)
    assert {"tigas/py.typed", "tigas_common/py.typed"} <= set(names)
    assert not [name for name in names if name.startswith(("tests/", "web/"))]
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        archived = {name.partition("/services/render/")[2] for name in archive.getnames()}
    assert {PAGE, *DEMO} <= archived


def test_the_command_runs_from_the_wheel_alone(run: Run) -> None:
    assert run("tigas", "--version").stdout == f"tigas {version('tigas')}\n"
    said = run("tigas", "--help")
    assert said.returncode == 0, said.stderr
    assert {"render", "dash", "store", "experiment"} <= set(said.stdout.split())
    for command in ("render", "demo"):
        refused = run("tigas", command)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert re.fullmatch(r".* (is|are) not installed: pip install 'tigas\[.+\] @ file:.+\.whl'\n", refused.stderr)


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
