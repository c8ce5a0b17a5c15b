"""Downloads from a server that disconnects, lies and mishandles ranges."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from tigas_common.downloads import FetchError, download

CONTENT = bytes(range(256)) * 4_000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


def names(directory: Path) -> set[str]:
    return {path.name for path in directory.iterdir()}


@dataclass
class Server:
    content: bytes = CONTENT
    etag: str = '"one"'
    ranges: bool = True
    status: int | None = None
    break_after: int | None = None
    """Bytes of a body after which the connection closes."""
    say_length: bool = True
    asked: list[str | None] = field(default_factory=list)
    """The Range header of each request."""

    def __call__(self, request: httpx.Request) -> httpx.Response:
        wanted = request.headers.get("Range")
        self.asked.append(wanted)
        if request.url.path == "/moved":
            return httpx.Response(302, headers={"Location": "/set.bin"})
        body, status, start = self.content, self.status or 200, 0
        if status == 200 and wanted and self.ranges and request.headers.get("If-Range") == self.etag:
            start = int(wanted.removeprefix("bytes=").removesuffix("-"))
            status = 206 if start < len(body) else 416
            body = body[start:]
        headers = {"ETag": self.etag} if self.etag else {}
        if status == 206:
            headers["Content-Range"] = f"bytes {start}-{len(self.content) - 1}/{len(self.content)}"
        if self.say_length:
            headers["Content-Length"] = str(len(body))
        return httpx.Response(status, headers=headers, content=self._sent(body))

    def _sent(self, body: bytes) -> Iterator[bytes]:
        yield from (body[start : start + 50_000] for start in range(0, self.break_after or len(body), 50_000))
        if self.break_after is not None:
            raise httpx.RemoteProtocolError("The connection was closed")


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def client(server: Server) -> httpx.Client:
    return httpx.Client(transport=httpx.MockTransport(server))


def fetch(client: httpx.Client, directory: Path, sha256: str | None = SHA256) -> Path:
    return download("http://server/set.bin", sha256, directory / "set.bin", 10**9, client, lambda *_: None)


def test_a_file_is_downloaded_with_progress_and_again_only_if_it_was_changed(
    server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    seen: list[tuple[int, int | None]] = []
    path = tmp_path / "new" / "set.bin"
    for requests, change in ((2, b""), (2, b"changed"), (4, b"")):
        told = download("http://server/moved", SHA256, path, 10**9, client, lambda *progress: seen.append(progress))
        assert (told, path.read_bytes()) == (path, CONTENT)
        assert names(path.parent) == {"set.bin"}
        assert len(server.asked) == requests
        if change:
            path.write_bytes(change)
    assert seen[-1] == (len(CONTENT), len(CONTENT))


def test_an_interrupted_download_goes_on_where_it_stopped(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    server.break_after = 300_000
    with pytest.raises(FetchError, match=r"broke off after 300,000 bytes; run it again to continue"):
        fetch(client, tmp_path)
    assert names(tmp_path) == {"set.bin.part", "set.bin.part.tag"}
    server.break_after = None
    assert fetch(client, tmp_path).read_bytes() == CONTENT
    assert server.asked == [None, "bytes=300000-"]
    assert names(tmp_path) == {"set.bin"}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"ranges": False}, {}),
        ({"etag": ""}, {}),
        ({"etag": 'W/"weak"'}, {"content": CONTENT[::-1]}),
        ({}, {"content": CONTENT[::-1], "etag": '"two"'}),
    ],
    ids=["no ranges", "no version", "weak version", "new version"],
)
def test_without_ranges_or_the_same_version_the_download_starts_over(
    before: dict[str, Any], after: dict[str, Any], server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    vars(server).update(before, break_after=300_000)
    with pytest.raises(FetchError, match="broke off"):
        fetch(client, tmp_path, None)
    vars(server).update(after, break_after=None)
    assert fetch(client, tmp_path, None).read_bytes() == server.content


def test_a_part_that_is_already_whole_is_fetched_afresh(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    (tmp_path / "set.bin.part").write_bytes(CONTENT + b"more")
    (tmp_path / "set.bin.part.tag").write_text(server.etag)
    assert fetch(client, tmp_path).read_bytes() == CONTENT
    assert len(server.asked) == 2


def test_a_wrong_checksum_is_refused_and_nothing_is_left(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    with pytest.raises(FetchError, match=f"was not kept: SHA256 .* expected {'0' * 64} but got {SHA256}\\.$"):
        fetch(client, tmp_path, "0" * 64)
    assert names(tmp_path) == set()


@pytest.mark.parametrize("status", [404, 403, 500, 416])
def test_an_error_answer_is_told_and_leaves_nothing(
    status: int, server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    server.status = status
    with pytest.raises(FetchError, match=f"was answered with {status}"):
        fetch(client, tmp_path)
    assert names(tmp_path) == set()


def test_nobody_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(FetchError, match="broke off"):
        download("http://127.0.0.1:9/a", None, tmp_path / "a", 1, httpx.Client(trust_env=False), lambda *_: None)


def test_a_server_that_never_stops_does_not_fill_the_disk(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    server.say_length = False
    seen: list[int] = []
    with pytest.raises(FetchError, match="has more than 100,000 bytes, so it was discarded"):
        download("http://server/set.bin", None, tmp_path / "a", 100_000, client, lambda done, _: seen.append(done))
    assert seen == [50_000, 100_000]
    assert names(tmp_path) == set()
