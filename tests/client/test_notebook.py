"""`tigas.show` without a notebook: the browser gets a widget's state."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tigas
from tests.client.conftest import Served, write_wall
from tests.eventually import eventually

START = {"position": [0.0, 1.0, 2.0], "quaternion": [0.0, 0.6, 0.0, 0.8]}
PROGRAM = """
import json, sys, tigas
viewers = [tigas.show(path) for path in sys.argv[1:]]
print(json.dumps([[viewer.server, viewer.scene] for viewer in viewers]))
"""


def test_the_browser_gets_server_scene_mode_and_settings() -> None:
    viewer = tigas.show("wall", server="http://viewer.example/", height=300, mode="video", profile=2)
    state = viewer.get_state(["server", "scene", "mode", "settings", "height", "_camera"])
    assert state == {
        "server": "http://viewer.example",
        "scene": "wall",
        "mode": "video",
        "settings": {"profile": 2},
        "height": 300,
        "_camera": None,
    }


def test_the_camera_follows_the_user_and_the_program() -> None:
    viewer = tigas.show("wall", server="http://viewer.example")
    viewer.set_state({"_camera": START})
    assert viewer.camera == tigas.Pose.from_quaternion((0, 1, 2), (0, 0.6, 0, 0.8))
    assert viewer.get_state("_camera")["_camera"] == START  # the user's movement goes on
    viewer.camera = tigas.Pose.from_quaternion((3, 0, 0), (0, 0, 0, 1))
    assert viewer.get_state("_camera")["_camera"] == {"position": [3, 0, 0], "quaternion": [0, 0, 0, 1]}
    viewer.camera = None
    assert viewer.get_state("_camera")["_camera"] is None


@pytest.mark.anyio
async def test_a_scene_may_only_be_left_out_if_there_is_one(served: Served) -> None:
    with pytest.raises(tigas.ClientError, match="Choose a scene: courtyard, wall"):
        await asyncio.to_thread(tigas.show, server=served.url)


def test_without_anywidget_one_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "tigas.widget", raising=False)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(ImportError, match=r"^anywidget is not installed: pip install .*\[notebook\]"):
        tigas.show("wall", server="http://viewer.example")


@pytest.mark.slow
@pytest.mark.anyio
async def test_cells_share_a_service_that_shows_files_and_ends_with_them(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_wall(tmp_path / name)
    files = [str(tmp_path / name / "wall/wall.ply") for name in ("one", "two", "one")]
    files.append(shutil.copy(files[0], str(tmp_path / "(Bob's) wall.ply")))
    argv = [sys.executable, "-c", PROGRAM, *files, str(tmp_path / "two/wall"), "courtyard"]
    done = await asyncio.to_thread(subprocess.run, argv, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    servers, scenes = zip(*json.loads(done.stdout), strict=True)
    assert scenes == ("wall", "wall-2", "wall", "Bob-s) wall", "wall-3", "courtyard")
    (server,) = set(servers)

    def has_ended() -> bool:
        try:
            tigas.Client(server).scenes()
        except tigas.Unreachable:
            return True
        return False

    await eventually(has_ended)
