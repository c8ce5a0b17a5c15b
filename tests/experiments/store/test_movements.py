"""Movement traces as the page gets them."""

from __future__ import annotations

import pytest

from tests.experiments.store.conftest import Running
from tests.not_files import NOT_FILES

pytestmark = pytest.mark.anyio

HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
WALK = "# anchor: start\n# description: A step & a look\n" + HEADER + "0,0,0,0,0,0,0,1\n1500,1,0,0,0,0,0,1\n"


async def test_movements_are_listed_and_read(store: Running) -> None:
    assert (await store.http.get("/movements")).json() == {"movements": []}
    (store.movements / "walk.csv").write_text(WALK)
    (store.movements / "absolute.csv").write_text(HEADER + "10,0,0,0,0,0,0,1\n20,0,0,0,0,0,0,1\n")
    (store.movements / "broken.csv").write_text(HEADER + "0,NaN,0,0,0,0,0,1\n")
    (store.movements / "torn.csv").write_bytes(HEADER.replace("z,", "z\r", 1).encode())
    (store.movements / "notes.txt").write_text("notes")
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
