"""Files that come over HTTP become scenes, whole and checked or not at all."""

from __future__ import annotations

import asyncio
import errno
import os
import time
from pathlib import Path

import httpx
import pytest

from tests.render.scenes import made_up, plys
from tests.render.uploads.client import TUS, begin, begun, part, upload
from tests.render.uploads.conftest import fail, ids, inodes, left, names, problem, serving, settings_for
from tigas_common.errors import Overloaded
from tigas_common.offload import offload_to_process
from tigas_render.uploads import parts
from tigas_render.uploads.parts import (
    FOLDER_NAME,
    IDLE_S,
    MAX_PER_ADDRESS,
    MAX_UPLOADS,
    STALLED_S,
    UnknownUpload,
    Uploads,
)

pytestmark = pytest.mark.anyio

SHELL = (made_up.FILES / "shell-3.spz").read_bytes()


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
            patched.setattr("tigas_render.server.library.commit_upload", take_memory)
            refused = await upload(client, "hostile.ply", plys.binary_ply())
        assert problem(refused) == (422, "too-costly")
        assert (await upload(client, "good.spz", SHELL)).status_code == 201
        assert await ids(client) == ["attic", "courtyard", "good"]
    assert len(left(models)) == 1, "the scene of the good one"


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
    assert names(models) == [FOLDER_NAME, "attic.ply", "shell.spz"]


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
    places = [await begun(client, "a.ply", 5) for _ in range(MAX_PER_ADDRESS)]
    refused = await client.post("/uploads", headers=begin("a.ply", 5))
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "60")
    assert "4 files are being uploaded from this address" in refused.json()["detail"]
    Uploads(models, 10).create("b", 5, "192.0.2.1")
    assert (await client.delete(places[0], headers=TUS)).status_code == 204
    await begun(client, "a.ply", 5)


def test_there_are_only_so_many_at_a_time(models: Path) -> None:
    uploads = Uploads(models, 10)
    for number in range(MAX_UPLOADS):
        uploads.create("a", 5, f"192.0.2.{number}")
    with pytest.raises(Overloaded, match="8 files are being uploaded already"):
        uploads.create("a", 5, "192.0.2.100")


def test_a_stalled_upload_keeps_no_place_and_an_empty_one_is_removed(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [time.time()]
    uploads = Uploads(models, 1000, clock=lambda: now[0])
    empty, begun, *_ = (uploads.create("a", 1000, "192.0.2.1") for _ in range(MAX_PER_ADDRESS))
    uploads.append(begun.id, 0, b"part")
    now[0] += STALLED_S + 5
    reserved: list[int] = []
    monkeypatch.setattr(parts, "check_free_space", lambda _, needed: reserved.append(needed))
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
        if FOLDER_NAME in source.parts:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        link(source, target, follow_symlinks=follow_symlinks)

    monkeypatch.setattr(os, "link", link_on_one_disk)
    at = await begun(client, "shell.spz", len(SHELL), SHELL)
    assert [(await client.post(f"{at}/scene")).status_code for _ in range(2)] == [201, 201]
    assert (models / "shell.spz").read_bytes() == SHELL
    assert names(models) == [FOLDER_NAME, "attic.ply", "shell.spz"]


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
    assert refused.json()["detail"] == "There is not enough disk space for shell; free some and try again."
    assert (await client.post(f"{at}/scene")).json() == {"id": "shell"}


@pytest.mark.parametrize("call", ["link", "fsync"])
async def test_a_scene_that_cannot_be_kept_leaves_its_name_free(
    client: httpx.AsyncClient, models: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    with monkeypatch.context() as broken:
        broken.setattr(os, call, fail)
        refused = await upload(client, "shell.spz", SHELL)
    assert (refused.status_code, refused.json()["detail"]) == (422, "shell could not be stored: Input/output error.")
    assert (await upload(client, "shell.spz", SHELL)).status_code == 201


async def test_a_check_that_outlives_its_service_is_not_forgotten(models: Path) -> None:
    async with serving(settings_for(models)) as client:
        at = await begun(client, "shell.spz", len(SHELL), SHELL)
    uploads = Uploads(models, limit=8_000_000_000)
    ours = uploads.get(at.rpartition("/")[2])
    async with serving(settings_for(models)) as client:
        with uploads.lock(ours):  # the check continues after its service was killed
            asked = asyncio.create_task(client.post(f"{at}/scene"))
            await client.get("/scenes")
            uploads.mark_added(ours)
            ours.path.rename(models / "shell.spz")
        assert [(await asked).status_code, (await client.post(f"{at}/scene")).status_code] == [201, 201]
