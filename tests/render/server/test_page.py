"""The web client's files: precompressed for clients that accept that, cached, and limited in their connections."""

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
CONFIG = load().config.model_copy(
    update={
        "services": {"near": "http://localhost:99", "far": "https://example.org/", "six": "http://[::1]:1"},
        "webtransport_url": "https://localhost:4433/render",
    }
)


@pytest.fixture
async def client(tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets/app.js").write_bytes(SCRIPT)
    (tmp_path / "assets/app.js.gz").write_bytes(gzip.compress(SCRIPT))
    (tmp_path / "assets/app.js.br").write_bytes(b"brotli")
    (tmp_path / "index.html").write_bytes(b"<!doctype html>")
    transport = httpx.ASGITransport(Page(tmp_path, lambda request: CONFIG))
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
async def test_a_client_gets_the_smallest_it_takes(
    client: httpx.AsyncClient, accepted: str, encoding: str | None
) -> None:
    async with client.stream("GET", "/assets/app.js", headers={"Accept-Encoding": accepted}) as answer:
        body = b"".join([part async for part in answer.aiter_raw()])
    assert answer.headers.get("content-encoding") == encoding
    assert answer.headers["vary"] == "Accept-Encoding"
    assert answer.headers["content-type"].partition(";")[0] == "text/javascript"
    assert int(answer.headers["content-length"]) == len(body)
    assert body == b"brotli" if encoding == "br" else (gzip.decompress(body) if encoding else body) == SCRIPT


async def test_who_has_a_file_in_this_encoding_does_not_get_it_again(client: httpx.AsyncClient) -> None:
    answers = {name: await client.get("/assets/app.js", headers={"Accept-Encoding": name}) for name in ("gzip", "x")}
    tags = {name: answer.headers["etag"] for name, answer in answers.items()}
    assert tags["gzip"] != tags["x"]
    for name, status in (("gzip", 304), ("x", 200)):
        headers = {"Accept-Encoding": name, "If-None-Match": tags["gzip"]}
        answer = await client.get("/assets/app.js", headers=headers)
        assert answer.status_code == status
        assert "immutable" in answer.headers["cache-control"]


async def test_workers_may_open_sessions_to_any_host(client: httpx.AsyncClient) -> None:
    policy = (await client.get("/assets/app.js")).headers["content-security-policy"]
    assert policy == "default-src 'self'; connect-src 'self' https:", "browsers cache it for good"


async def test_the_page_may_reach_the_services_and_nothing_else(client: httpx.AsyncClient) -> None:
    answer = await client.get("/")
    assert (answer.content, answer.headers["cache-control"]) == (b"<!doctype html>", "no-cache")
    assert "content-encoding" not in answer.headers
    directives = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
    http = ["http:", "http://localhost:*", "https://example.org:*", "https://localhost:*"]
    assert directives["connect-src"].split() == ["'self'", *http, *(each.replace("http", "ws") for each in http)]
    assert directives["default-src"] == "'self'"
    assert directives["worker-src"] == "'self' blob:", "the sorting of downloaded scenes is a worker of its renderer's"
    assert "script-src" not in directives
