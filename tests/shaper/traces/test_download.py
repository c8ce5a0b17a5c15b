"""Downloads from a local server that disconnects, lies, and mishandles ranges."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest

from tests.shaper.traces.files import names
from tigas_shaper.traces import download as download_module
from tigas_shaper.traces.download import download
from tigas_shaper.traces.sources import FetchError, SourceFile

CONTENT = bytes(range(256)) * 4_000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@dataclass
class Server:
    """The server's script, and its requests."""

    url: str = ""
    content: bytes = CONTENT
    etag: str = '"one"'
    ranges: bool = True
    status: int | None = None
    break_after: int | None = None
    """Bytes of a body after which the connection closes."""
    say_length: bool = True
    asked: list[str | None] = field(default_factory=list)
    """The Range header of each request."""


@pytest.fixture
def server() -> Iterator[Server]:
    state = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            state.asked.append(wanted)
            if self.path == "/moved":
                self.send_response(302)
                self.send_header("Location", "/set.bin")
                self.end_headers()
                return
            body, status, start = state.content, state.status or 200, 0
            if status == 200 and wanted and state.ranges and self.headers.get("If-Range") == state.etag:
                start = int(wanted.removeprefix("bytes=").removesuffix("-"))
                status = 206 if start < len(body) else 416
                body = body[start:]
            self.send_response(status)
            if state.etag:
                self.send_header("ETag", state.etag)
            if status == 206:
                self.send_header("Content-Range", f"bytes {start}-{len(state.content) - 1}/{len(state.content)}")
            if state.say_length:
                self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            with suppress(ConnectionError):  # a client may go in the middle
                self.wfile.write(body if state.break_after is None else body[: state.break_after])

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        state.url = f"http://127.0.0.1:{http.server_port}"
        yield state
        http.shutdown()
        thread.join()


@pytest.fixture
def client() -> Iterator[httpx.Client]:
    with httpx.Client(timeout=10, trust_env=False) as client:
        yield client


def fetch(server: Server, client: httpx.Client, directory: Path, sha256: str | None = SHA256) -> Path:
    return download(SourceFile(url=f"{server.url}/set.bin", sha256=sha256), directory, client, lambda *_: None)


def test_a_file_is_downloaded_with_progress_and_not_again(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    file = SourceFile(url=f"{server.url}/set.bin", sha256=SHA256)
    path = download(file, tmp_path / "new", client, lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == CONTENT
    assert names(path.parent) == {"set.bin"}
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert fetch(server, client, tmp_path / "new") == path
    assert len(server.asked) == 1


def test_an_interrupted_download_goes_on_where_it_stopped(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    server.break_after = 300_000
    with pytest.raises(FetchError, match=r"broke off after 300,000 bytes; run it again to go on"):
        fetch(server, client, tmp_path)
    assert names(tmp_path) == {"set.bin.part", "set.bin.part.tag"}
    server.break_after = None
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT
    assert server.asked == [None, "bytes=300000-"]
    assert names(tmp_path) == {"set.bin"}


def test_a_new_version_on_the_server_is_not_glued_to_the_old_part(
    server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    server.break_after = 300_000
    with pytest.raises(FetchError):
        fetch(server, client, tmp_path)
    server.content, server.etag, server.break_after = CONTENT[::-1], '"two"', None
    assert fetch(server, client, tmp_path, None).read_bytes() == CONTENT[::-1]


@pytest.mark.parametrize(("ranges", "etag"), [(False, '"one"'), (True, ""), (True, 'W/"weak"')])
def test_without_ranges_or_a_version_the_download_starts_over(
    ranges: bool, etag: str, server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    server.ranges, server.etag, server.break_after = ranges, etag, 300_000
    with pytest.raises(FetchError, match="broke off"):
        fetch(server, client, tmp_path)
    server.break_after = None
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT


def test_a_part_that_is_already_whole_is_fetched_afresh(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    (tmp_path / "set.bin.part").write_bytes(CONTENT + b"more")
    (tmp_path / "set.bin.part.tag").write_text(server.etag)
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT
    assert len(server.asked) == 2


def test_a_wrong_checksum_is_refused_and_nothing_is_left(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    with pytest.raises(FetchError, match=f"was not kept: SHA256 .* expected {'0' * 64} but got {SHA256}\\.$"):
        fetch(server, client, tmp_path, "0" * 64)
    assert names(tmp_path) == set()


def test_a_file_that_was_changed_on_disk_is_not_passed_off_as_the_published_one(
    server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    fetch(server, client, tmp_path).write_bytes(b"changed")
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT
    assert len(server.asked) == 2


@pytest.mark.parametrize("status", [404, 403, 500, 416])
def test_an_error_answer_is_told_and_leaves_nothing(
    status: int, server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    server.status = status
    with pytest.raises(FetchError, match=f"was answered with {status}"):
        fetch(server, client, tmp_path)
    assert names(tmp_path) == set()


def test_nobody_there_is_told(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    with pytest.raises(FetchError, match="broke off"):
        download(SourceFile(url="http://127.0.0.1:9/set.bin"), tmp_path, client, lambda *_: None)


def test_a_moved_file_is_followed(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    path = download(SourceFile(url=f"{server.url}/moved", sha256=SHA256), tmp_path, client, lambda *_: None)
    assert path.read_bytes() == CONTENT


def test_a_server_that_never_stops_does_not_fill_the_disk(
    server: Server, client: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(download_module, "MAX_BYTES", 100_000)
    server.say_length = False
    with pytest.raises(FetchError, match="is larger than"):
        fetch(server, client, tmp_path, None)
    assert names(tmp_path) == set()
