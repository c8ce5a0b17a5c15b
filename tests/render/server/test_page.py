"""Precompressed files are sent to clients that accept them, the originals to all others."""

from __future__ import annotations

import gzip
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from tests.cluster.hosts import load
from tigas_render.server.page import Page

pytestmark = pytest.mark.anyio
SCRIPT = b"export const answer = 42;\n" * 50


@pytest.fixture
async def client(tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    (tmp_path / "app.js").write_bytes(SCRIPT)
    (tmp_path / "app.js.gz").write_bytes(gzip.compress(SCRIPT))
    (tmp_path / "app.js.br").write_bytes(b"brotli")
    (tmp_path / "plain.css").write_bytes(b"body {}")
    transport = httpx.ASGITransport(Page(tmp_path, lambda request: load().config))
    async with httpx.AsyncClient(transport=transport, base_url="http://page.test") as client:
        yield client


@pytest.mark.parametrize(
    ("accepted", "encoding"),
    [
        ("gzip, deflate, br", "br"),
        ("gzip, deflate", "gzip"),
        ("br;q=0, gzip;q=0.5", "gzip"),
        ("br; q=0.000, gzip; q=0", None),
        ("identity", None),
        ("", None),
    ],
)
async def test_a_client_gets_the_smallest_that_it_takes(
    client: httpx.AsyncClient, accepted: str, encoding: str | None
) -> None:
    async with client.stream("GET", "/app.js", headers={"Accept-Encoding": accepted}) as answer:
        body = b"".join([part async for part in answer.aiter_raw()])
    assert answer.headers.get("content-encoding") == encoding
    assert answer.headers["vary"] == "Accept-Encoding"
    assert answer.headers["content-type"].partition(";")[0] == "text/javascript"
    assert int(answer.headers["content-length"]) == len(body)
    assert body == b"brotli" if encoding == "br" else (gzip.decompress(body) if encoding else body) == SCRIPT


async def test_what_is_not_compressed_comes_as_it_is(client: httpx.AsyncClient) -> None:
    answer = await client.get("/plain.css")
    assert (answer.content, answer.headers.get("content-encoding")) == (b"body {}", None)


async def test_who_has_a_file_in_this_encoding_does_not_get_it_again(client: httpx.AsyncClient) -> None:
    answers = {name: await client.get("/app.js", headers={"Accept-Encoding": name}) for name in ("gzip", "x")}
    tags = {name: answer.headers["etag"] for name, answer in answers.items()}
    assert tags["gzip"] != tags["x"]
    for name, status in (("gzip", 304), ("x", 200)):
        headers = {"Accept-Encoding": name, "If-None-Match": tags["gzip"]}
        assert (await client.get("/app.js", headers=headers)).status_code == status
