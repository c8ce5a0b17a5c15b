"""Downloads over HTTP: whole, in ranges, resumed, and refused."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from reference.ply import write_ply
from tests.render.scenes import made_up, plys
from tigas_render.downloads.cache import MAX_DOWNLOADS, MAX_DOWNLOADS_PER_ADDRESS
from tigas_render.raster.instant import InstantRasterizer
from tigas_render.scenes.directory import read_scene_file
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = pytest.mark.anyio
URL = "/scenes/cloud/download/compressed"


@pytest.fixture
async def service(tmp_path: Path) -> AsyncIterator[RenderService]:
    for name in ("cloud", "broken"):
        (tmp_path / name).mkdir()
    write_ply(tmp_path / "cloud" / "cloud.ply", plys.gaussians(500, sh_degree=1))
    (tmp_path / "broken" / "broken.ply").write_bytes(b"ply\n")
    made_up.unzip(tmp_path / "levels", "shell.streamed.zip")
    (tmp_path / "levels" / "scene.json").write_text("{}")
    settings = RenderSettings(scenes=tmp_path, cache=tmp_path / ".cache")
    async with RenderService.open(settings, InstantRasterizer()) as service:
        yield service


@pytest.fixture
async def client(service: RenderService) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(create_app(service), raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://localhost:8080") as client:
        yield client


async def test_a_scene_is_downloaded_whole_and_then_known(client: httpx.AsyncClient, tmp_path: Path) -> None:
    info = (await client.get("/scenes/cloud")).json()
    assert info["downloads"] == [{"form": "compressed", "bytes": None, "sha256": None, "gaussians": None}]
    answer = await client.get(URL)
    assert answer.headers["content-length"] == str(len(answer.content))
    assert answer.headers["accept-ranges"] == "bytes"
    assert answer.headers["content-disposition"] == 'attachment; filename="cloud.compressed.ply"'
    (tmp_path / "got.ply").write_bytes(answer.content)
    got = read_scene_file(tmp_path / "got.ply").load()
    assert (len(got), got.sh_degree) == (500, 1)
    sha256 = hashlib.sha256(answer.content).hexdigest()
    assert answer.headers["etag"] == f'"{sha256}"'
    assert answer.headers["timing-allow-origin"] == "*"
    [known] = next(scene for scene in (await client.get("/scenes")).json() if scene["id"] == "cloud")["downloads"]
    assert known == {"form": "compressed", "bytes": len(answer.content), "sha256": sha256, "gaussians": 500}
    assert (await client.get("/scenes/cloud")).json()["state"] == "unloaded"  # it need not be on the device


async def test_what_was_cut_off_is_resumed(client: httpx.AsyncClient) -> None:
    head = await client.head(URL)
    length, tag = int(head.headers["content-length"]), head.headers["etag"]
    assert head.content == b""
    whole = (await client.get(URL)).content
    assert len(whole) == length
    rest = await client.get(URL, headers={"Range": "bytes=1000-", "If-Range": tag})
    assert rest.status_code == 206
    assert rest.headers["content-range"] == f"bytes 1000-{length - 1}/{length}"
    assert rest.content == whole[1000:]
    part = await client.get(URL, headers={"Range": "bytes=10-19"})
    assert (part.content, part.headers["content-length"]) == (whole[10:20], "10")
    changed = await client.get(URL, headers={"Range": "bytes=1000-", "If-Range": '"of-another-file"'})
    assert (changed.status_code, changed.content) == (200, whole)  # a part would not fit the client's other parts
    beyond = await client.get(URL, headers={"Range": f"bytes={length}-"})
    assert (beyond.status_code, beyond.headers["content-range"]) == (416, f"bytes */{length}")
    assert (await client.get(URL, headers={"If-None-Match": tag})).status_code == 304


async def test_refusals_are_sentences(client: httpx.AsyncClient) -> None:
    async def refusal(scene: str) -> tuple[int, str]:
        answer = await client.get(f"/scenes/{scene}/download/compressed")
        return answer.status_code, answer.json()["detail"]

    assert await refusal("nowhere") == (404, "There is no scene 'nowhere'.")
    assert await refusal("broken") == (422, "broken.ply is truncated: its header has no 'end_header'.")
    assert (await client.get("/scenes/cloud/download/ply")).status_code == 404


async def test_a_scene_with_levels_is_streamed_file_by_file(client: httpx.AsyncClient, tmp_path: Path) -> None:
    info = (await client.get("/scenes/levels")).json()
    assert [download["form"] for download in info["downloads"]] == ["compressed", "streamed"]
    meta = await client.get("/scenes/levels/download/streamed/lod-meta.json")
    assert meta.content == (tmp_path / "levels" / "lod-meta.json").read_bytes()
    for name in meta.json()["filenames"]:
        part = await client.get(f"/scenes/levels/download/streamed/{name}")
        assert part.content == (tmp_path / "levels" / name).read_bytes()
        again = await client.get(
            f"/scenes/levels/download/streamed/{name}", headers={"If-None-Match": part.headers["etag"]}
        )
        assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    ("scene", "name"),
    [
        ("levels", "scene.json"),
        ("levels", "nothing.webp"),
        ("levels", "a/" * 2500 + "x.sog"),
        ("levels", ".hidden.webp"),
        ("levels", "..%2Fcloud%2Fmeta.json"),
        ("levels", "%2Fetc%2Fmeta.json"),
        ("levels", ""),
        ("cloud", "cloud.ply"),
        ("cloud", "lod-meta.json"),
    ],
)
async def test_nothing_but_the_files_of_levels_is_streamed(
    client: httpx.AsyncClient, tmp_path: Path, scene: str, name: str
) -> None:
    for place in ("cloud/meta.json", "levels/.hidden.webp", "cloud/lod-meta.json"):
        (tmp_path / place).write_text("secret")
    refused = await client.get(f"/scenes/{scene}/download/streamed/{name}")
    assert refused.status_code == 404
    assert "secret" not in refused.text


async def test_so_many_may_read_at_once(client: httpx.AsyncClient, service: RenderService) -> None:
    def reading(addresses: list[str]) -> None:
        service.file_sender.limit._running.clear()
        service.file_sender.limit._running.update(addresses)

    reading(["127.0.0.1"] * (MAX_DOWNLOADS_PER_ADDRESS - 1))
    assert (await client.get(URL)).status_code == 200
    assert (await client.get(URL)).status_code == 200  # a finished reader makes room
    for addresses in (["127.0.0.1"] * MAX_DOWNLOADS_PER_ADDRESS, [str(number) for number in range(MAX_DOWNLOADS)]):
        reading(addresses)
        refused = await client.get(URL)
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "5")
        assert refused.json()["detail"].startswith("Too many scenes are being downloaded;")
