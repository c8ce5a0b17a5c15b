"""Rendering on a CPU without PyTorch, as in the images for CPUs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from reference.ply import write_ply
from tests.render.scenes.made_up import shell

PROGRAM = """
import sys
sys.modules["torch"] = None  # an ImportError for whoever imports it
from pkgutil import walk_packages
import tigas_render
from tigas_common.cli import main
for module in walk_packages(tigas_render.__path__, "tigas_render."):
    if not module.name.startswith("tigas_render.raster.cuda."):
        __import__(module.name)
main()
"""


@pytest.mark.slow
def test_whatever_a_cpu_needs_can_be_imported_and_a_scene_is_rendered(tmp_path: Path) -> None:
    ply, picture = tmp_path / "scene.ply", tmp_path / "view.png"
    write_ply(ply, shell())
    command = ["scene", "preview", str(ply), str(picture)]
    run = subprocess.run([sys.executable, "-c", PROGRAM, *command], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    with Image.open(picture) as image:
        assert image.size == (640, 360)
