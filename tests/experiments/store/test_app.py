"""The store over HTTP, its metrics and movements, and its folder for incomplete files."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.experiments.store.conftest import Running
from tests.not_files import NOT_FILES
from tests.web.server import Store
from tigas_common.errors import StartError
from tigas_experiments.store.metrics import MonitoredLock
from tigas_experiments.store.workspace import Workspace

pytestmark = pytest.mark.anyio


async def test_what_is_not_there_is_told_as_everywhere(store: Running) -> None:
    for method, path, status in (("GET", "/none", 404), ("PUT", "/experiments", 405), ("GET", "/experiments/x/y", 404)):
        answer = await store.http.request(method, path)
        assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")


async def test_a_plan_has_a_limit(store: Running) -> None:
    answer = await store.http.post("/experiments", json={"file": "x" * 16_000_000})
    assert (answer.status_code, answer.json()["type"]) == (413, "tigas:body-too-large")
    assert store.kept() == []


def test_the_store_needs_neither_a_browser_nor_torch() -> None:
    script = (
        "import sys; import tigas_experiments.store.main; "
        "print([name for name in ('playwright', 'torch', 'numba', 'av', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_second_store_of_the_same_results_is_refused(tmp_path: Path) -> None:
    with Workspace.open(tmp_path):
        with pytest.raises(StartError, match="Another store keeps its results"), Workspace.open(tmp_path):
            pass
        with pytest.raises(AssertionError, match="Another store keeps its results"), Store("--results", str(tmp_path)):
            pass
    with Workspace.open(tmp_path):
        pass


def test_a_results_path_that_is_no_folder_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="Results cannot be kept in"), Workspace.open(tmp_path / "file"):
        pass


async def test_one_at_a_time_and_the_rest_are_seen_to_wait() -> None:
    now = 100.0
    turns = MonitoredLock(lambda: now)

    async def work() -> None:
        async with turns:
            await asyncio.Event().wait()

    assert (turns.waiting, turns.working, turns.age_s) == (0, False, 0.0)
    async with turns:
        first = asyncio.create_task(work())
        await asyncio.sleep(0)
        now = 103.0
        second = asyncio.create_task(work())
        await asyncio.sleep(0)
        now = 105.0
        assert (turns.waiting, turns.working, turns.age_s) == (2, True, 5.0)
        first.cancel()  # its viewer has left
        await asyncio.gather(first, return_exceptions=True)
        assert (turns.waiting, turns.age_s) == (1, 2.0)
    await asyncio.sleep(0)
    assert (turns.waiting, turns.working, turns.age_s) == (0, True, 0.0)
    second.cancel()
    await asyncio.gather(second, return_exceptions=True)
    assert not turns.working


HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
WALK = "# anchor: start\n# description: A step & a look\n" + HEADER + "0,0,0,0,0,0,0,1\n1500,1,0,0,0,0,0,1\n"


async def test_movements_are_listed_and_read(store: Running) -> None:
    assert (await store.http.get("/movements")).json() == {"movements": []}
    (store.movements / "walk.csv").write_text(WALK)
    (store.movements / "absolute.csv").write_text(HEADER + "10,0,0,0,0,0,0,1\n20,0,0,0,0,0,0,1\n")
    (store.movements / "broken.csv").write_text(HEADER + "0,NaN,0,0,0,0,0,1\n")
    (store.movements / "torn.csv").write_bytes(HEADER.replace("z,", "z\r", 1).encode())
    (store.movements / "notes.txt").write_text("notes")
    os.close(os.open(bytes(store.movements) + b"/Fu\xdfweg.csv", os.O_CREAT))
    assert (await store.http.get("/movements")).json()["movements"] == [
        {"name": "absolute", "duration_ms": 10, "anchor": "scene", "description": ""},
        {"name": "walk", "duration_ms": 1500, "anchor": "start", "description": "A step & a look"},
    ]
    answer = await store.http.get("/movements/walk")
    assert (answer.text, answer.headers["content-type"]) == (WALK, "text/csv; charset=utf-8")
    for name, told in (("broken", "line 2"), ("none", "no movement 'none'"), ("notes.txt", "no movement")):
        refused = await store.http.get(f"/movements/{name}")
        assert (refused.status_code, refused.json()["type"]) == (404, "tigas:unknown-movement")
        assert told in refused.json()["detail"]


@pytest.mark.parametrize("kind", NOT_FILES)
async def test_what_is_no_file_among_them_holds_nothing_up(store: Running, kind: str) -> None:
    (store.movements / "walk.csv").write_text(WALK)
    NOT_FILES[kind](store.movements / "made.csv")
    assert [each["name"] for each in (await store.http.get("/movements")).json()["movements"]] == ["walk"]
    assert (await store.http.get("/movements/made")).status_code == 404


async def test_a_movement_that_was_replaced_is_read_again(store: Running) -> None:
    path = store.movements / "walk.csv"
    path.write_text(WALK)
    assert (await store.http.get("/movements")).json()["movements"][0]["duration_ms"] == 1500
    path.write_text(WALK.replace("1500", "2500.5"))
    assert (await store.http.get("/movements")).json()["movements"][0]["duration_ms"] == 2500.5
    path.unlink()
    assert (await store.http.get("/movements/walk")).status_code == 404
