"""Files that come over HTTP become scenes, whole and checked or not at all."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import os
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple

import httpx
import pytest

from tests.common.test_weights import NETWORK, made
from tests.render.fakes import FakeRasterizer
from tests.render.scenes import made_up, plys
from tests.render.uploads.client import TUS, begin, begun, part, upload
from tigas_common.address import Address
from tigas_common.errors import Overloaded
from tigas_common.limits import HttpLimits
from tigas_common.offload import Limit, Offload, offload_to_process
from tigas_common.runner import serve_http
from tigas_common.weights import write_weights
from tigas_render.server.app import create_app
from tigas_render.server.library import Library
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_render.uploads import parts
from tigas_render.uploads.parts import FOLDER, IDLE_S, MOST, MOST_OF_ADDRESS, STALLED_S, UnknownUpload, Uploads

pytestmark = pytest.mark.anyio

SHELL = (made_up.FILES / "shell-3.spz").read_bytes()


@pytest.fixture
def models(tmp_path: Path) -> Path:
    directory = tmp_path / "models"
    plys.write(directory / "attic.ply", plys.binary_ply())
    return directory


def settings_for(models: Path, **changes: Any) -> RenderSettings:
    return RenderSettings(scenes=models, cache=Path("/nonexistent"), **changes)


T = TypeVar("T")
Ts = TypeVarTuple("Ts")


async def in_a_thread(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
    """Replaces the worker process, which takes seconds to start."""
    return await asyncio.to_thread(function, *arguments)


@asynccontextmanager
async def serving(settings: RenderSettings, offload: Offload = in_a_thread) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a service, over a socket."""
    async with RenderService.open(settings, FakeRasterizer()) as service:
        service.library = Library(settings, service.registry, service.shelf, offload)
        async with (
            serve_http(create_app(service), Address("127.0.0.1", 0), HttpLimits()) as port,
            httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60) as client,
        ):
            yield client


@pytest.fixture
async def client(models: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with serving(settings_for(models)) as client:
        yield client


def left(models: Path) -> list[str]:
    """Files other than scenes."""
    return [path.name for path in (models / FOLDER).iterdir()] if (models / FOLDER).exists() else []


def names(models: Path) -> list[str]:
    return sorted(path.name for path in models.iterdir())


def inodes(*paths: Path) -> set[int]:
    return {path.stat().st_ino for path in paths}


async def ids(client: httpx.AsyncClient) -> list[str]:
    return [scene["id"] for scene in (await client.get("/scenes")).json()]


def problem(answer: httpx.Response) -> tuple[int, str]:
    """The status and type of a refusal."""
    return answer.status_code, answer.json()["type"].removeprefix("tigas:")


async def test_a_file_becomes_a_scene_whatever_its_name_ends_in(client: httpx.AsyncClient, models: Path) -> None:
    added = await upload(client, "my shell.zip", SHELL)
    assert (added.status_code, added.json()) == (201, {"id": "my shell"})
    assert added.headers["location"] == "/scenes/my%20shell"
    assert await ids(client) == ["attic", "courtyard", "my shell"]
    assert (models / "my shell.spz").read_bytes() == SHELL
    info = (await client.get("/scenes/my%20shell")).json()
    assert (info["state"], info["gaussians"], info["builtin"]) == ("unloaded", made_up.COUNT, False)


async def test_who_did_not_hear_that_it_was_added_asks_again(client: httpx.AsyncClient) -> None:
    at = await begun(client, "shell.spz", len(SHELL), SHELL)
    answers = await asyncio.gather(*(client.post(f"{at}/scene") for _ in range(3)))
    assert [answer.status_code for answer in (*answers, await client.post(f"{at}/scene"))] == [201] * 4


async def test_an_upload_goes_on_where_its_connection_was_closed(client: httpx.AsyncClient, models: Path) -> None:
    content = plys.binary_ply(40_000)
    at = await begun(client, "big.ply", len(content))

    async def offset() -> int:
        return int((await client.head(at, headers=TUS)).headers["upload-offset"])

    _, writer = await asyncio.open_connection(client.base_url.host, client.base_url.port)
    lines = (f"{name}: {value}\r\n" for name, value in {**part(0), "Content-Length": len(content)}.items())
    writer.write(f"PATCH {at} HTTP/1.1\r\nHost: localhost\r\n{''.join(lines)}\r\n".encode() + content[:1_500_000])
    async with asyncio.timeout(20):
        while await offset() == 0:  # noqa: ASYNC110 - only asking tells
            await asyncio.sleep(0.01)
        writer.close()
        early = await client.post(f"{at}/scene")
        assert problem(early) == (409, "wrong-offset")
        late = await client.patch(at, headers=part(500), content=content[500:])
        assert problem(late) == (409, "wrong-offset")
        sent = late
        while sent.status_code != 204:  # the closed connection's data is still being written
            begins = await offset()
            sent = await client.patch(at, headers=part(begins), content=content[begins:])
    assert begins > 1_000_000
    assert sent.headers["upload-offset"] == str(len(content))
    assert (await client.post(f"{at}/scene")).status_code == 201
    assert (models / "big.ply").read_bytes() == content


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("letter.ply", b"Dear reader, " * 10, "letter is not a scene"),
        ("short.ply", plys.binary_ply()[:-4], "short is truncated"),
        ("empty.splat", b"", "empty"),
        ("bomb.spz", SHELL[:40] + os.urandom(4000), "bomb"),
    ],
)
async def test_what_is_no_scene_is_refused_in_a_sentence_and_leaves_nothing(
    client: httpx.AsyncClient, models: Path, name: str, content: bytes, words: str
) -> None:
    refused = await upload(client, name, content)
    assert problem(refused) == (422, "broken-scene")
    assert words in refused.json()["detail"]
    assert (await ids(client), left(models)) == (["attic", "courtyard"], [])


async def test_a_file_that_promises_more_than_scenes_may_take_is_not_read(models: Path) -> None:
    async with serving(settings_for(models, memory_gb=len(SHELL) / 1e9)) as client:
        refused = await upload(client, "vast.spz", SHELL)
        assert refused.status_code == 422
        assert "MB in memory, and all scenes together may take 0.0 MB" in refused.json()["detail"]
    assert left(models) == []


def take_memory(*_: object) -> None:
    """Replaces a check that needs much memory."""
    bytearray(1_000_000_000)


@pytest.mark.slow
async def test_a_file_that_takes_too_much_to_check_ends_nothing_but_its_own_process(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serving(settings_for(models), offload_to_process) as client:
        with monkeypatch.context() as patched:
            patched.setattr("tigas_render.server.library.CHECK_MEMORY", -8_000_000_000)  # no more than it has already
            patched.setattr("tigas_render.server.library.keep_upload", take_memory)
            refused = await upload(client, "hostile.ply", plys.binary_ply())
        assert problem(refused) == (422, "too-costly")
        assert (await upload(client, "good.spz", SHELL)).status_code == 201
        assert await ids(client) == ["attic", "courtyard", "good"]
    assert len(left(models)) == 1, "what the good one has become"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        *((name, "cannot be a scene's name") for name in ("../../evil.ply", "/etc/passwd", "a/b.ply", "..")),
        *((name, "cannot be a scene's name") for name in (".hidden.ply", "x\n.ply", "a\\b.ply")),
        ("attic.compressed.compressed.ply", "its file would be the scene attic"),
        ("attic.compressed.compressed.spz", "its file would be the scene attic"),
    ],
)
async def test_a_name_leads_nowhere_else(client: httpx.AsyncClient, models: Path, name: str, words: str) -> None:
    refused = await client.post("/uploads", headers=begin(name, 10))
    assert problem(refused) == (422, "scene-not-added")
    assert words in refused.json()["detail"]
    assert left(models) == []


@pytest.mark.parametrize("id", ["..%2F..%2Fattic", "0" * 32, "x", "%2e%2e"])
async def test_an_upload_is_named_by_nothing_but_its_own_id(client: httpx.AsyncClient, models: Path, id: str) -> None:
    for answer in (
        await client.head(f"/uploads/{id}", headers=TUS),
        await client.patch(f"/uploads/{id}", headers=part(0), content=b"x"),
        await client.delete(f"/uploads/{id}", headers=TUS),
        await client.post(f"/uploads/{id}/scene"),
    ):
        assert answer.status_code in (404, 405), answer.request
    assert names(models) == ["attic.ply"]


async def test_of_two_uploads_with_one_name_one_becomes_the_scene(client: httpx.AsyncClient, models: Path) -> None:
    places = [await begun(client, "shell.spz", len(SHELL), SHELL) for _ in range(2)]
    answers = await asyncio.gather(*(client.post(f"{at}/scene") for at in places))
    assert sorted(answer.status_code for answer in answers) == [201, 422]
    assert "There is a scene shell already" in next(each for each in answers if each.status_code == 422).text
    again = await client.post("/uploads", headers=begin("shell.sog", 10))
    assert "There is a scene shell already" in again.json()["detail"]
    assert names(models) == [FOLDER, "attic.ply", "shell.spz"]


async def test_what_is_too_large_is_refused_before_it_comes_and_while_it_does(client: httpx.AsyncClient) -> None:
    refused = await client.post("/uploads", headers=begin("vast.ply", 8_000_000_001))
    assert problem(refused) == (413, "body-too-large")
    assert "up to 8 GB" in refused.json()["detail"]
    assert (await client.options("/uploads")).headers["tus-max-size"] == "8000000000"
    at = await begun(client, "short.ply", 10)
    more = await client.patch(at, headers=part(0), content=b"x" * 11)
    assert more.status_code == 413
    assert (await client.head(at, headers=TUS)).headers["upload-offset"] == "0"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({**begin("a.ply", 5), "Tus-Resumable": "0.2"}, 412),
        ({**begin("a.ply", 5), "Upload-Length": "-5"}, 400),
        ({**begin("a.ply", 5), "Upload-Length": "9" * 30}, 400),
        ({**begin("a.ply", 5), "Upload-Metadata": "filename !!!"}, 400),
        ({**begin("a.ply", 5), "Upload-Metadata": "name YQ=="}, 400),
        ({**begin("a.ply", 5), "Origin": "https://evil.example"}, 403),
        ({**begin("a.ply", 5), "Host": "evil.example"}, 421),
        (begin("a" * 256, 5), 400),
    ],
)
async def test_what_is_no_upload_is_said(
    client: httpx.AsyncClient, models: Path, headers: dict[str, str], status: int
) -> None:
    refused = await client.post("/uploads", headers=headers)
    assert (refused.status_code, refused.json()["status"]) == (status, status)
    assert left(models) == []


async def test_the_disk_keeps_a_reserve(client: httpx.AsyncClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_common.files.SPARE_BYTES", 1 << 60)
    refused = await client.post("/uploads", headers=begin("a.ply", 5))
    assert (refused.status_code, refused.json()["detail"]) == (507, "The disk that holds the models is full.")


async def test_an_address_has_some_of_the_places(client: httpx.AsyncClient, models: Path) -> None:
    places = [await begun(client, "a.ply", 5) for _ in range(MOST_OF_ADDRESS)]
    refused = await client.post("/uploads", headers=begin("a.ply", 5))
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "60")
    assert "4 files are being uploaded from this address" in refused.json()["detail"]
    Uploads(models, 10).create("b", 5, "192.0.2.1")
    assert (await client.delete(places[0], headers=TUS)).status_code == 204
    await begun(client, "a.ply", 5)


def test_there_are_only_so_many_at_a_time(models: Path) -> None:
    uploads = Uploads(models, 10)
    for number in range(MOST):
        uploads.create("a", 5, f"192.0.2.{number}")
    with pytest.raises(Overloaded, match="8 files are being uploaded already"):
        uploads.create("a", 5, "192.0.2.100")


def test_a_stalled_upload_keeps_no_place_and_an_empty_one_is_removed(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [time.time()]
    uploads = Uploads(models, 1000, clock=lambda: now[0])
    empty, begun, *_ = (uploads.create("a", 1000, "192.0.2.1") for _ in range(MOST_OF_ADDRESS))
    uploads.append(begun.id, 0, b"part")
    now[0] += STALLED_S + 5
    reserved: list[int] = []
    monkeypatch.setattr(parts, "check_room", lambda _, needed: reserved.append(needed))
    new = uploads.create("b", 10, "192.0.2.1")
    assert reserved == [10]
    assert set(left(models)) == {begun.id, new.id}
    with pytest.raises(UnknownUpload):
        uploads.get(empty.id)
    uploads.append(begun.id, 4, b" and the rest")
    assert uploads.get(begun.id).offset == 17


def test_what_nobody_goes_on_with_is_removed(models: Path) -> None:
    now = [time.time()]
    uploads = Uploads(models, 1000, clock=lambda: now[0])
    kept, dropped = (uploads.create(name, 10, "192.0.2.1") for name in ("kept", "dropped"))
    for each in (kept, dropped):
        uploads.append(each.id, 0, b"part")
    now[0] += IDLE_S - 5
    os.utime(kept.path, (now[0], now[0]))
    now[0] += 10
    uploads.expire()
    assert left(models) == [kept.id]
    assert kept.id != dropped.id


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


async def test_without_a_directory_there_is_nothing_to_change(tmp_path: Path) -> None:
    async with serving(settings_for(tmp_path / "missing")) as client:
        assert (await client.get("/config.json")).json()["max_upload_bytes"] is None
        refused = await client.post("/uploads", headers=begin("a.ply", 5))
    assert refused.json()["detail"] == "The service may not write to its models directory."


async def test_an_added_scene_is_on_the_disk(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = set()
    fsync = os.fsync

    def note(handle: int) -> None:
        synced.add(os.fstat(handle).st_ino)
        fsync(handle)

    monkeypatch.setattr(os, "fsync", note)
    assert (await upload(client, "shell.spz", SHELL)).status_code == 201
    assert inodes(models, models / "shell.spz") <= synced


async def test_the_folder_of_uploads_may_be_on_another_disk(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = os.link

    def link_on_one_disk(source: Path, target: Path, *, follow_symlinks: bool) -> None:
        if FOLDER in source.parts:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        link(source, target, follow_symlinks=follow_symlinks)

    monkeypatch.setattr(os, "link", link_on_one_disk)
    at = await begun(client, "shell.spz", len(SHELL), SHELL)
    assert [(await client.post(f"{at}/scene")).status_code for _ in range(2)] == [201, 201]
    assert (models / "shell.spz").read_bytes() == SHELL
    assert names(models) == [FOLDER, "attic.ply", "shell.spz"]


def fail(*_: object, **__: object) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


async def test_an_upload_for_which_the_disk_has_no_room_is_kept_and_added_later(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    at = await begun(client, "shell.spz", len(SHELL), SHELL)
    with monkeypatch.context() as broken:
        broken.setattr(os, "link", full)
        refused = await client.post(f"{at}/scene")
    assert problem(refused) == (507, "disk-full")
    assert refused.json()["detail"] == "There is no room on the disk for shell; free some, and try again."
    assert (await client.post(f"{at}/scene")).json() == {"id": "shell"}


@pytest.mark.parametrize("call", ["link", "fsync"])
async def test_a_scene_that_cannot_be_kept_leaves_its_name_free(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    with monkeypatch.context() as broken:
        broken.setattr(os, call, fail)
        refused = await upload(client, "shell.spz", SHELL)
    assert (refused.status_code, refused.json()["detail"]) == (422, "shell could not be kept: Input/output error.")
    assert (await upload(client, "shell.spz", SHELL)).status_code == 201


async def test_a_check_that_outlives_its_service_is_not_forgotten(models: Path) -> None:
    async with serving(settings_for(models)) as client:
        at = await begun(client, "shell.spz", len(SHELL), SHELL)
    uploads = Uploads(models, limit=8_000_000_000)
    ours = uploads.get(at.rpartition("/")[2])
    async with serving(settings_for(models)) as client:
        with uploads.locked(ours):  # the check continues after its service was killed
            asked = asyncio.create_task(client.post(f"{at}/scene"))
            await client.get("/scenes")
            uploads.note_adding(ours)
            ours.path.rename(models / "shell.spz")
        assert [(await asked).status_code, (await client.post(f"{at}/scene")).status_code] == [201, 201]


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
            assert refused.json()["detail"] == "The disk that holds the models refused: Input/output error."
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
    assert refused.json()["detail"] == "The disk that holds the models refused: Input/output error."
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


VIEW = {"camera": {"position": [0, -2, -8], "look_at": [0, -1, 0]}, "up": [0, 1, 0]}


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
        (saving("paths", keyframes=[POSE | {"t_ms": 0}, AWAY | {"t_ms": 9}]), "a loop has the pose of the first"),
        (saving("paths", keyframes=[POSE | {"t_ms": 5}, POSE | {"t_ms": 5}]), "greater t_ms than the one before"),
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
