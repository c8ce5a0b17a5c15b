"""Pages rename, delete and describe scenes, which survive power failures and hostile names."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.common.test_weights import NETWORK, made
from tests.render.scenes import made_up, plys
from tests.render.uploads.client import begin, part
from tests.render.uploads.conftest import fail, ids, left, names, problem, serving, settings_for
from tigas_common.weights import write_weights

pytestmark = pytest.mark.anyio

VIEW = {"camera": {"position": [0, -2, -8], "look_at": [0, -1, 0]}, "up": [0, 1, 0]}


@pytest.mark.parametrize(
    ("changes", "editable"),
    [
        ({}, True),
        ({"lan": True}, False),
        ({"http": "0.0.0.0:0"}, False),
        ({"quic": "[::]:0"}, False),
        ({"allow_hosts": ("tigas.example.org",)}, False),
        ({"edit_scenes": False}, False),
        ({"lan": True, "edit_scenes": True}, True),
    ],
)
async def test_only_loopback_lets_pages_change_scenes_unless_it_is_told_to(
    models: Path, changes: dict[str, Any], editable: bool
) -> None:
    async with serving(settings_for(models, **changes)) as client:
        config = (await client.get("/config.json")).json()
        assert config["max_upload_bytes"] == (8_000_000_000 if editable else None)
        assert (config["why_no_training"] is None) is editable
        answers = [
            await client.post("/uploads", headers=begin("a.ply", 5)),
            await client.patch(f"/uploads/{'0' * 32}", headers=part(0), content=b"x"),
            await client.post("/scenes/attic/rename", json={"name": "loft"}),
            await client.patch("/scenes/attic" if editable is False else "/scenes/loft", json=VIEW),
            await client.post("/scenes/attic/enhance" if editable is False else "/scenes/loft/enhance"),
            await client.delete("/scenes/attic/enhance" if editable is False else "/scenes/loft/enhance"),
            await client.delete("/scenes/attic" if editable is False else "/scenes/loft"),
        ]
    refusals = [answer for answer in answers if answer.status_code == 403]
    assert len(refusals) == (0 if editable else 7)
    assert all("--edit-scenes allows it" in answer.json()["detail"] for answer in refusals)
    assert (models / "attic.ply").exists() is not editable


SHELL = (made_up.FILES / "shell-3.spz").read_bytes()


async def test_a_failed_rename_changes_nothing(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    (models / "hall" / "scene.json").write_text(json.dumps({"name": "The hall"}))
    await client.get("/scenes?scan=1")

    with monkeypatch.context() as broken:
        broken.setattr(os, "link", fail)
        broken.setattr(Path, "rename", fail)
        for id in ("attic", "hall"):
            refused = await client.post(f"/scenes/{id}/rename", json={"name": "loft"})
            assert refused.json()["detail"] == "The disk that holds the models reported an error: Input/output error."
    assert names(models) == ["attic.ply", "hall"]
    assert json.loads((models / "hall" / "scene.json").read_text()) == {"name": "The hall"}
    assert (await client.post("/scenes/attic/rename", json={"name": "loft"})).status_code == 200


async def test_a_scene_is_renamed_and_deleted(client: httpx.AsyncClient, models: Path) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    (models / "hall" / "scene.json").write_text(json.dumps({"name": "The hall", "background": [0, 0, 1]}))
    await client.get("/scenes?scan=1")
    loft = await client.post("/scenes/attic/rename", json={"name": "loft"})
    assert (loft.json()["id"], loft.json()["name"]) == ("loft", "loft")
    foyer = await client.post("/scenes/hall/rename", json={"name": "Foyer"})
    assert (foyer.json()["id"], foyer.json()["name"], foyer.json()["background"]) == ("Foyer", "Foyer", [0, 0, 1])
    assert await ids(client) == ["Foyer", "courtyard", "loft"]
    for id in ("Foyer", "loft"):
        assert (await client.delete(f"/scenes/{id}")).status_code == 204
    assert (await client.get("/scenes/loft")).json()["detail"] == "There is no scene 'loft'."
    assert (await ids(client), names(models)) == (["courtyard"], [])


async def test_a_failed_removal_leaves_no_folder_behind(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    await client.get("/scenes?scan=1")
    with monkeypatch.context() as broken:
        broken.setattr(Path, "rename", fail)
        refused = await client.delete("/scenes/hall")
    assert refused.json()["detail"] == "The disk that holds the models reported an error: Input/output error."
    assert names(models) == ["attic.ply", "hall"]


async def test_a_scene_that_is_half_removed_is_listed_no_more(client: httpx.AsyncClient, models: Path) -> None:
    (models / "attic.scene.json").mkdir()
    assert problem(await client.delete("/scenes/attic")) == (500, "storage-failed")
    assert "attic" not in await ids(client)


async def test_the_networks_of_a_file_are_renamed_and_removed_with_it(models: Path, tmp_path: Path) -> None:
    digest = hashlib.sha256((models / "attic.ply").read_bytes()).hexdigest()
    (tmp_path / "enhance").mkdir()
    write_weights(tmp_path / "enhance" / "attic.safetensors", made(NETWORK, scene=digest))
    async with serving(settings_for(models).model_copy(update={"cache": tmp_path})) as client:
        before = (await client.get("/scenes/attic/enhance.safetensors")).raise_for_status()
        await client.post("/scenes/attic/rename", json={"name": "loft"})
        after = await client.get("/scenes/loft/enhance.safetensors")
        assert (after.status_code, after.content) == (200, before.content)
        await client.delete("/scenes/loft")
    assert list((tmp_path / "enhance").iterdir()) == [], "another scene may get this name"


async def test_the_start_view_of_a_file_and_of_a_folder_is_set_and_moves_with_it(
    client: httpx.AsyncClient, models: Path
) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    (models / "hall" / "scene.json").write_text(json.dumps({"background": [0, 0, 1]}))
    await client.get("/scenes?scan=1")
    for id in ("attic", "hall"):
        for when in ("unloaded", "loaded"):
            before = (await client.get(f"/scenes/{id}")).json()
            assert before["state"] == when
            view = {**VIEW, "camera": {"position": [len(when), 0, 0], "look_at": [0, 0, 0]}}
            answer = (await client.patch(f"/scenes/{id}", json=view)).json()
            assert {name: answer[name] for name in view} == view
            assert (answer["state"], answer["background"]) == (when, before["background"]), "nothing else changes"
            await client.post(f"/scenes/{id}/load")
        renamed = (await client.post(f"/scenes/{id}/rename", json={"name": f"{id}2"})).json()
        assert renamed["up"] == [0, 1, 0]
        assert (await client.delete(f"/scenes/{id}2")).status_code == 204
    assert names(models) == []


@pytest.mark.parametrize(
    ("change", "status", "sentence"),
    [
        ({"up": [0, 0, 0]}, 400, "a vector of length zero points nowhere"),
        ({"camera": {"position": [1, 2, 3], "look_at": [1, 2, 3]}}, 400, "camera cannot look at its own position"),
        ({"up": [0, "1e999", 0]}, 400, "up"),
        ({"camera": None}, 400, "camera"),
        ({"else": 1}, 400, "else"),
    ],
)
async def test_a_view_that_shows_nothing_is_refused(
    client: httpx.AsyncClient, models: Path, change: dict[str, Any], status: int, sentence: str
) -> None:
    answer = await client.patch("/scenes/attic", json=VIEW | change)
    assert answer.status_code == status
    assert sentence in answer.json()["detail"]
    assert names(models) == ["attic.ply"]


POSE = {"position": [1.0, 2.0, 3.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
AWAY = {"position": [9.0, 2.0, 3.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
TOUR = {
    "keyframes": [POSE | {"t_ms": 0.0}, AWAY | {"t_ms": 900.0}, POSE | {"t_ms": 1900.0}],
    "easing": "ease-in-out",
    "loop": True,
}


@pytest.mark.parametrize("id", ["attic", "hall"])
async def test_views_and_paths_of_a_file_and_of_a_folder_survive_a_restart_and_move_with_it(
    models: Path, id: str
) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    (models / "hall" / "scene.json").write_text(json.dumps({"background": [0, 0, 1]}))
    saved = ("Entrance", "../../up", "__proto__", "日の出")
    async with serving(settings_for(models)) as client:
        before = (await client.get(f"/scenes/{id}")).json()
        for name in saved:
            await client.patch(f"/scenes/{id}", json={"views": {name: POSE | {"quaternion": [0, 0, 0, 9]}}})
        after = (await client.patch(f"/scenes/{id}", json={"paths": {"Tour": TOUR, "Short": TOUR}})).json()
        assert after == before | {"views": dict.fromkeys(saved, POSE), "paths": {"Tour": TOUR, "Short": TOUR}}
        await client.patch(f"/scenes/{id}", json=VIEW)
    async with serving(settings_for(models)) as client:
        edit = {"views": {"__proto__": None, "Entrance": None, "Door": POSE}, "paths": {"Short": None}}
        await client.patch(f"/scenes/{id}", json=edit)
        renamed = (await client.post(f"/scenes/{id}/rename", json={"name": f"{id}2"})).json()
        assert list(renamed["views"]) == ["../../up", "日の出", "Door"]
        assert renamed["paths"] == {"Tour": TOUR}
        assert renamed["up"] == VIEW["up"]
        assert renamed["background"] == before["background"]
        listed = next(scene for scene in (await client.get("/scenes")).json() if scene["id"] == f"{id}2")
        assert listed == renamed | {"views": {}, "paths": {}}


async def test_edits_at_the_same_time_are_all_kept(client: httpx.AsyncClient) -> None:
    saved = [f"View {number}" for number in range(24)]
    await asyncio.gather(*(client.patch("/scenes/attic", json={"views": {name: POSE}}) for name in saved))
    assert sorted((await client.get("/scenes/attic")).json()["views"]) == sorted(saved)


def saving(kind: str, **changes: Any) -> str:
    """An edit that saves a view or path which is as it should be but for some fields."""
    return json.dumps({kind: {"a": (POSE if kind == "views" else TOUR) | changes}})


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (saving("views", position=[0, 0, float("nan")]), "views.a.position.2"),
        (saving("views", position=[0, float("inf"), 0]), "views.a.position.1"),
        (saving("views", position=[1e10, 0, 0]), "views.a.position.0"),
        (saving("views", position=[0, 0]), "views.a.position.2"),
        (saving("views", quaternion=[0, 0, 0, 0]), "a quaternion of length zero is not a rotation"),
        (saving("views", else_=1), "views.a.else_"),
        (json.dumps({"views": {"": POSE}}), "at least 1 character"),
        (json.dumps({"views": {"x" * 101: POSE}}), "at most 100 characters"),
        (json.dumps({"views": {" a": POSE}}), "no spaces around them"),
        (json.dumps({"views": {"a\x1b[2J": POSE}}), "only printable characters"),
        (json.dumps({"views": {str(number): POSE for number in range(100)}}), "at most 100 saved views and 20 paths"),
        (json.dumps({"paths": {str(number): TOUR for number in range(21)}}), "at most 100 saved views and 20 paths"),
        (json.dumps({"views": [POSE]}), "views"),
        (json.dumps({"views": None}), "views"),
        (saving("paths", keyframes=[POSE | {"t_ms": 0}]), "a path has 2 to 64 keyframes"),
        (saving("paths", keyframes=[POSE | {"t_ms": ms} for ms in range(65)]), "a path has 2 to 64 keyframes"),
        (saving("paths", keyframes=[POSE | {"t_ms": 0}, AWAY | {"t_ms": 9}]), "a loop must have the pose of the first"),
        (saving("paths", keyframes=[POSE | {"t_ms": 5}, POSE | {"t_ms": 5}]), "greater t_ms than the previous one"),
        (saving("paths", keyframes=[POSE | {"t_ms": 0}, POSE | {"t_ms": 1e12}]), "t_ms"),
        (saving("paths", easing="bounce"), "easing"),
        ('{"views": {"a": ' * 400, "JSON"),
    ],
)
async def test_a_hostile_edit_is_refused_in_a_sentence_and_loses_nothing(
    client: httpx.AsyncClient, models: Path, edit: str, sentence: str
) -> None:
    await client.patch("/scenes/attic", json={"views": {"Door": POSE}})
    before = (models / "attic.scene.json").read_bytes()
    answer = await client.patch("/scenes/attic", content=edit)
    assert problem(answer) == (400, "invalid-request")
    assert sentence in answer.json()["detail"]
    assert (models / "attic.scene.json").read_bytes() == before


async def test_a_description_that_cannot_be_read_is_left_as_it_is(client: httpx.AsyncClient, models: Path) -> None:
    (models / "attic.scene.json").write_text('{"name": "The attic",')
    answer = await client.patch("/scenes/attic", json={"views": {"Door": POSE}})
    assert problem(answer) == (422, "broken-scene")
    assert (models / "attic.scene.json").read_text() == '{"name": "The attic",'
    assert (await client.post("/scenes/attic/rename", json={"name": "loft"})).status_code == 200
    assert (models / "loft.scene.json").read_text() == '{"name": "The attic",'
    assert names(models) == ["loft.ply", "loft.scene.json"]


@pytest.mark.parametrize("name", ["../up", "", "a/b", "hall", "courtyard", ".x", "x" * 300, "hall.compressed"])
async def test_what_cannot_be_a_name_changes_nothing(client: httpx.AsyncClient, models: Path, name: str) -> None:
    plys.write(models / "hall" / "scene.ply", plys.binary_ply())
    refused = await client.post("/scenes/attic/rename", json={"name": name})
    assert refused.status_code in (400, 422)
    assert names(models) == ["attic.ply", "hall"]


@pytest.mark.parametrize("name", ["風" * 86, "é" * 101], ids=["three bytes each", "two bytes each"])
async def test_a_name_that_is_too_long_for_a_file_is_refused_in_a_sentence(
    client: httpx.AsyncClient, models: Path, name: str
) -> None:
    for refused in (
        await client.post("/uploads", headers=begin(f"{name}.ply", 100)),
        await client.post("/scenes/attic/rename", json={"name": name}),
    ):
        assert problem(refused) == (422, "scene-not-added")
        size = len(name.encode())
        assert refused.json()["detail"] == f"A scene's name has at most 200 bytes in UTF-8, and this one has {size}."
    assert (names(models), left(models)) == (["attic.ply"], [])
    longest = name[: 200 // len(name[0].encode())]
    assert (await client.post("/scenes/attic/rename", json={"name": longest})).status_code == 200
    assert (await client.patch(f"/scenes/{longest}", json=VIEW)).json()["up"] == VIEW["up"]


async def test_the_built_in_scene_stays(client: httpx.AsyncClient) -> None:
    for answer in (
        await client.delete("/scenes/courtyard"),
        await client.post("/scenes/courtyard/rename", json={"name": "yard"}),
        await client.patch("/scenes/courtyard", json=VIEW),
    ):
        assert problem(answer) == (409, "built-in-scene")
        assert "is part of TIGAS" in answer.json()["detail"]
    assert (await client.get("/scenes/courtyard")).json()["builtin"] is True


async def test_of_a_link_only_the_link_is_deleted(client: httpx.AsyncClient, models: Path, tmp_path: Path) -> None:
    elsewhere = plys.write(tmp_path / "disk" / "far" / "scene.ply", plys.binary_ply())
    (models / "far").symlink_to(elsewhere.parent)
    await client.get("/scenes?scan=1")
    assert (await client.delete("/scenes/far")).status_code == 204
    assert elsewhere.exists()
    assert "far" not in await ids(client)
