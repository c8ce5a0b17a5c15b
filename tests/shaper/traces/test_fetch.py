"""Published sets: their list, downloads from a server that disconnects, lies and mishandles ranges, and archives."""

from __future__ import annotations

import hashlib
import io
import stat
import threading
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest

from tigas_shaper.traces.fetch import FetchError, SourceFile, download, load_sources, unpack

CONTENT = bytes(range(256)) * 4_000
SHA256 = hashlib.sha256(CONTENT).hexdigest()
FILE = 'title = "t"\npage = "p"\nlicence = "l"\ncite = "c"\n'


def names(directory: Path) -> set[str]:
    return {path.name for path in directory.iterdir()}


def test_the_list_that_tigas_brings_is_sound() -> None:
    sources = load_sources()
    assert set(sources) == {"ghent-4g", "irish-5g", "mahimahi", "sabre-4g"}
    for source in sources.values():
        assert all(file.url.startswith("https://") for file in source.files)
        assert len({file.name for file in source.files}) == len(source.files)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[a", "cannot be read"),
        ("a = 1", "cannot be read"),
        (f"[a]\n{FILE}files = []", "cannot be read"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/y", sha256 = "abc" }}]', "cannot be read"),
        (f'["../a"]\n{FILE}files = [{{ url = "https://x/y" }}]', "'../a' in the list of trace sets cannot be the name"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/%2e%2e" }}]', "'..' in the list"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/..%5Cy" }}]', "cannot be the name of a file"),
        (f'[a]\n{FILE}files = [{{ url = "https://x/" }}]', "'' in the list"),
        (f'[a]\n{FILE}files = [{{ url = "file:///etc/passwd" }}]', "is not an HTTP address"),
    ],
)
def test_a_list_that_is_wrong_or_reaches_outside_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "sources.toml"
    path.write_text(text)
    with pytest.raises(FetchError) as error:
        load_sources(path)
    assert sentence in error.value.detail


@dataclass
class Server:
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


def test_a_file_is_downloaded_with_progress_and_again_only_if_it_was_changed(
    server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    seen: list[tuple[int, int | None]] = []
    file = SourceFile(url=f"{server.url}/moved", sha256=SHA256)
    for requests, change in ((2, b""), (2, b"changed"), (4, b"")):
        path = download(file, tmp_path / "new", client, lambda done, total: seen.append((done, total)))
        assert path.read_bytes() == CONTENT
        assert names(path.parent) == {"moved"}
        assert len(server.asked) == requests
        if change:
            path.write_bytes(change)
    assert seen[-1] == (len(CONTENT), len(CONTENT))


def test_an_interrupted_download_goes_on_where_it_stopped(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    server.break_after = 300_000
    with pytest.raises(FetchError, match=r"broke off after 300,000 bytes; run it again to continue"):
        fetch(server, client, tmp_path)
    assert names(tmp_path) == {"set.bin.part", "set.bin.part.tag"}
    server.break_after = None
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT
    assert server.asked == [None, "bytes=300000-"]
    assert names(tmp_path) == {"set.bin"}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"ranges": False}, {}),
        ({"etag": ""}, {}),
        ({"etag": 'W/"weak"'}, {}),
        ({}, {"content": CONTENT[::-1], "etag": '"two"'}),
    ],
    ids=["no ranges", "no version", "weak version", "new version"],
)
def test_without_ranges_or_the_same_version_the_download_starts_over(
    before: dict[str, Any], after: dict[str, Any], server: Server, client: httpx.Client, tmp_path: Path
) -> None:
    vars(server).update(before, break_after=300_000)
    with pytest.raises(FetchError, match="broke off"):
        fetch(server, client, tmp_path, None)
    vars(server).update(after, break_after=None)
    assert fetch(server, client, tmp_path, None).read_bytes() == server.content


def test_a_part_that_is_already_whole_is_fetched_afresh(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    (tmp_path / "set.bin.part").write_bytes(CONTENT + b"more")
    (tmp_path / "set.bin.part.tag").write_text(server.etag)
    assert fetch(server, client, tmp_path).read_bytes() == CONTENT
    assert len(server.asked) == 2


def test_a_wrong_checksum_is_refused_and_nothing_is_left(server: Server, client: httpx.Client, tmp_path: Path) -> None:
    with pytest.raises(FetchError, match=f"was not kept: SHA256 .* expected {'0' * 64} but got {SHA256}\\.$"):
        fetch(server, client, tmp_path, "0" * 64)
    assert names(tmp_path) == set()


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


def test_a_server_that_never_stops_does_not_fill_the_disk(
    server: Server, client: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tigas_shaper.traces.fetch.MAX_BYTES", 100_000)
    server.say_length = False
    with pytest.raises(FetchError, match="is larger than"):
        fetch(server, client, tmp_path, None)
    assert names(tmp_path) == set()


def archive(path: Path, members: dict[str, bytes], link: str | None = None) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = ((stat.S_IFLNK if name == link else stat.S_IFREG) | 0o644) << 16
            file.writestr(info, content, zipfile.ZIP_DEFLATED)
    return path


def test_an_archive_is_unpacked_beside_itself_once(tmp_path: Path) -> None:
    path = archive(tmp_path / "set.zip", {"set/a.log": b"1", "set/deep/b.log": b"2"})
    folder = unpack(path)
    assert (folder / "set" / "deep" / "b.log").read_bytes() == b"2"
    assert names(tmp_path) == {"set.zip", "set"}
    (folder / "note").touch()
    assert unpack(path) == folder
    assert (folder / "note").exists()


@pytest.mark.parametrize(
    ("member", "link", "sentence"),
    [
        ("../evil", False, "'../evil' would be written elsewhere"),
        ("a/../../evil", False, "would be written elsewhere"),
        ("/tmp/evil", False, "would be written elsewhere"),
        ("..\\evil", False, "would be written elsewhere"),
        ("C:evil", False, "would be written elsewhere"),
        ("way", True, "'way' is a link"),
    ],
)
def test_an_archive_that_reaches_outside_is_refused_and_nothing_is_left(
    member: str, link: bool, sentence: str, tmp_path: Path
) -> None:
    path = archive(tmp_path / "set.zip", {"fine.log": b"1", member: b"../.."}, member if link else None)
    with pytest.raises(FetchError) as error:
        unpack(path)
    assert sentence in error.value.detail
    assert names(tmp_path) == {"set.zip"}
    assert not (tmp_path.parent / "evil").exists()


def test_a_zip_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_shaper.traces.fetch.MAX_UNPACKED_BYTES", 1_000_000)
    path = archive(tmp_path / "set.zip", {"bomb": b"\0" * 2_000_000})
    assert path.stat().st_size < 10_000
    with pytest.raises(FetchError, match="holds more than"):
        unpack(path)
    assert names(tmp_path) == {"set.zip"}


def test_a_damaged_archive_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    path = archive(tmp_path / "set.zip", {"a.log": bytes(range(256)) * 100})
    damaged = bytearray(path.read_bytes())
    damaged[60:90] = b"\0" * 30
    for content in (bytes(damaged), b"no zip at all", path.read_bytes()[:-30]):
        path.write_bytes(content)
        with pytest.raises(FetchError, match="cannot be unpacked"):
            unpack(path)
        assert names(tmp_path) == {"set.zip"}


def test_names_that_appear_twice_in_an_archive_are_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("a", b"1")
        with pytest.warns(UserWarning, match="Duplicate name"):
            file.writestr("a", b"2")
    (tmp_path / "set.zip").write_bytes(buffer.getvalue())
    with pytest.raises(FetchError, match="cannot be unpacked"):
        unpack(tmp_path / "set.zip")
