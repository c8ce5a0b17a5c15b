"""Downloads one file, goes on where an earlier try broke off, and keeps it only if its checksum is right.

The kept-up library for data sets, pooch, checks sums but starts over after a break; hence these few lines over httpx.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import httpx

from tigas_shaper.traces.sources import FetchError, SourceFile

MAX_BYTES = 1_000_000_000
"""Of one file; a server that never stops must not fill the disk."""

Progress = Callable[[int, int | None], None]
"""Hears how many bytes there are and, if the server says so, how many there will be."""


def download(file: SourceFile, directory: Path, client: httpx.Client, progress: Progress) -> Path:
    """The file in `directory`, from the network if it is not there. Raises FetchError and OSError.

    While incomplete it is called NAME.part, and NAME.part.tag holds the server's version of it: a part is continued
    only if the server still has that version.
    """
    target = directory / file.name
    part, tag = directory / f"{file.name}.part", directory / f"{file.name}.part.tag"
    if target.exists():
        _check(target, file)
        return target
    directory.mkdir(parents=True, exist_ok=True)
    try:
        _transfer(file, part, tag, client, progress)
    except httpx.HTTPError as error:
        kept = f" after {part.stat().st_size:,} bytes; run it again to go on" if part.exists() else ""
        raise FetchError(f"{file.url} broke off{kept}: {error or type(error).__name__}.") from None
    try:
        _check(part, file)
    except FetchError:
        part.unlink()
        raise
    finally:
        tag.unlink(missing_ok=True)
    return part.replace(target)


def _transfer(file: SourceFile, part: Path, tag: Path, client: httpx.Client, progress: Progress) -> None:
    have = part.stat().st_size if part.exists() and tag.exists() else 0
    headers = {"Accept-Encoding": "identity"}  # ranges and checksums are of the file itself
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": tag.read_text("ascii")}
    with client.stream("GET", file.url, headers=headers, follow_redirects=True) as response:
        match response.status_code:
            case 200:  # all of it: the first try, or the server does no ranges, or has a newer version
                _store(file, response, part, tag, 0, progress)
                return
            case 206 if response.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                _store(file, response, part, tag, have, progress)
                return
            case 416 if have:  # the part is as long as the file or longer: there is nothing to go on with
                part.unlink()
            case _:
                raise FetchError(f"{file.url} was answered with {response.status_code} {response.reason_phrase}.")
    _transfer(file, part, tag, client, progress)


def _store(file: SourceFile, response: httpx.Response, part: Path, tag: Path, have: int, progress: Progress) -> None:
    """Append to the `have` bytes of the part, or start it."""
    version = response.headers.get("ETag", "")
    if version.startswith('"') and version.isascii():  # a weak tag, W/"…", does not promise equal bytes
        tag.write_text(version, "ascii")
    else:
        tag.unlink(missing_ok=True)
    length = response.headers.get("Content-Length", "")
    total = have + int(length) if length.isdecimal() else None
    with part.open("ab" if have else "wb") as out:
        for chunk in response.iter_raw():
            have += len(chunk)
            if have > MAX_BYTES:
                break
            out.write(chunk)
            progress(have, total)
    if have > MAX_BYTES:
        part.unlink()
        tag.unlink(missing_ok=True)
        raise FetchError(f"{file.url} is larger than {MAX_BYTES // 1_000_000} MB, so it was dropped.")


def _check(path: Path, file: SourceFile) -> None:
    if file.sha256 is None:
        return
    with path.open("rb") as content:
        actual = hashlib.file_digest(content, "sha256").hexdigest()
    if actual != file.sha256:
        raise FetchError(f"{file.url} has the SHA-256 {actual}, not {file.sha256}; it was not kept.")
