"""The page's shaders on this machine's own GPU driver, or on Chromium's software one, against PyTorch."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.enhance import WEIGHTS, write
from tests.enhance.networks import LADDER, random_networks, weights_file

ROOT = Path(__file__).parents[2]
GPUS = (Path("/dev/dri"), Path("/dev/nvidiactl"))
SWIFTSHADER = Path("/usr/lib/chromium/vk_swiftshader_icd.json")
TINY = [rung.model_copy(update={"width": 48, "height": 27}) for rung in LADDER]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shaders for small frames."""
    if shutil.which("node") is None or not (ROOT / "web/node_modules").exists():
        pytest.skip("the web client's packages are not installed: cd web && npm ci")
    folder = tmp_path_factory.mktemp("shaders")
    weights = folder / "some.safetensors"
    weights.write_bytes(weights_file(random_networks({1: 1, 2: 2}, layers=3, channels=8), TINY))
    write(folder, weights)
    return folder


def measured(folder: Path) -> subprocess.CompletedProcess[str]:
    if importlib.util.find_spec("wgpu") is None:
        pytest.skip("wgpu is not installed: pip install wgpu")
    environment = dict(os.environ)
    if SWIFTSHADER.exists() and not any(gpu.exists() for gpu in GPUS):
        environment["VK_DRIVER_FILES"] = str(SWIFTSHADER)
    command = [sys.executable, "-m", "benchmarks.enhance", "--shaders", str(folder), "--frames", "3"]
    run = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=100)
    if "wgpu finds no GPU" in run.stderr:
        pytest.skip(run.stderr.strip())
    return run


def test_each_network_is_timed_and_compared_with_pytorch(folder: Path) -> None:
    run = measured(folder)
    assert run.returncode == 0, run.stderr
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in run.stdout.splitlines() if "×" in line]
    assert {(row[0], row[1], row[2], row[3]) for row in rows} == {
        ("1", "48×27", "1", "1,008"),
        ("2", "48×27", "2", "1,656"),
    }
    assert all(float(row[-1]) < 2 for row in rows)


def test_a_picture_that_is_not_pytorchs_fails(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "shaders"
    shutil.copytree(folder, other)
    (other / WEIGHTS).write_bytes(weights_file(random_networks({1: 1, 2: 2}, layers=3, channels=8, seed=1), TINY))
    run = measured(other)
    assert run.returncode == 1
    assert "differs from PyTorch's" in run.stderr
