"""The notebooks in examples/ run from their first cell to their last."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import av
import pytest

from tests.client.conftest import Served
from tests.client.test_async_client import is_red

pytestmark = pytest.mark.anyio

EXAMPLES = Path(__file__).parents[2] / "examples"


def run_cells(notebook: Path, **parameters: object) -> None:
    """Run a notebook like a kernel, with other values for its cell `parameters`."""
    scope: dict[str, Any] = {}
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "a notebook is kept without its outputs"
            exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), scope)
            if "parameters" in cell["metadata"].get("tags", ()):
                assert parameters.keys() <= scope.keys()
                scope |= parameters


async def test_a_camera_path_becomes_a_video(served: Served, tmp_path: Path) -> None:
    chosen = {"URL": served.url, "SCENE": "wall", "SIZE": (64, 36), "SECONDS": 1, "FRAMES_PER_S": 6}
    path = tmp_path / "orbit.mp4"
    await asyncio.to_thread(run_cells, EXAMPLES / "camera_path.ipynb", VIDEO=str(path), **chosen)
    with av.open(path) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert [frame.shape for frame in frames] == [(36, 64, 3)] * 6
    assert all(is_red(tuple(frame[18, 32])) for frame in frames), "an orbit looks at its subject"
