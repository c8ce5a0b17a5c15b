"""Real captured scenes for tests: never part of the repository, so tests that need them skip where they are absent.

They are looked for in `../shared` beside the repository, or where TIGAS_SHARED points.
"""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.prerequisites import CAPTURED_SCENES, SHARED

SOURCES: dict[str, tuple[int, tuple[str, ...]]] = {
    "guitar": (0, ("guitar.compressed.ply",)),
    "flowers": (2, tuple(f"flowers_lod0_{part}.sog" for part in range(4))),
    "narcissus": (0, ("narcissus.sog",)),
    "playbot": (2, ("playbot_lod0.sog",)),
}
"""SH degree and files of each scene."""


def shared_file(*parts: str) -> Path:
    """A file of the shared data; skips the test where it is absent."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        CAPTURED_SCENES.skip()
    return path


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="tigas-scenes-")


@functools.cache
def _converted(name: str, tool: Path, sources: tuple[Path, ...], degree: int) -> Path:
    path = Path(_scratch().name) / f"{name}.ply"
    command = [sys.executable, tool, path, *sources, "--deg", str(degree)]
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return path


def reference_scene_ply(name: str) -> Path:
    """A captured scene as an INRIA PLY, converted once per test run."""
    degree, files = SOURCES[name]
    sources = tuple(shared_file("scenes", file) for file in files)
    return _converted(name, shared_file("tools", "splat_convert.py"), sources, degree)
