"""The command `tigas`, which every image has, whatever else it lacks."""

from __future__ import annotations

import subprocess
import sys

LOADED = """
import sys
from importlib.metadata import entry_points
from tigas_common.cli import COMMANDS
for point in entry_points(group=COMMANDS):
    point.load()
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
NOT_EVERYWHERE = {
    "PIL",
    "aioquic",
    "av",
    "filelock",
    "httpx",
    "jinja2",
    "matplotlib",
    "numba",
    "numpy",
    "playwright",
    "pooch",
    "psutil",
    "requests",
    "scipy",
    "skimage",
    "starlette",
    "torch",
    "uvicorn",
    "zipstream",
}


def test_all_commands_load_without_what_only_some_services_have() -> None:
    run = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert {"tigas_experiments", "tigas_render", "tigas_shaper", "tigas_dash"} <= loaded
    assert not loaded & NOT_EVERYWHERE
