"""Downloads one file. pooch keeps it if its checksum is right; an interrupted transfer is resumed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import httpx
import pooch

from tigas_shaper.traces.sources import FetchError, SourceFile

MAX_BYTES = 1_000_000_000
"""Of one file; a server that never stops must not fill the disk."""

Progress = Callable[[int, int | None], None]
"""Progress callback: bytes so far and, if the server announces it, the total."""


def download(file: SourceFile, directory: Path, client: httpx.Client, progress: Progress) -> Path:
    """The file in `directory`, from the network unless it is there unchanged. Raises FetchError and OSError.

    While incomplete it is called NAME.part, and NAME.part.tag holds the server's version of it: a part is continued
    only if the server still has that version.
    """
    part, tag = directory / f"{file.name}.part", directory / f"{file.name}.part.tag"

    def resume(url: str, target: str, _: object) -> None:
        _transfer(url, part, tag, client, progress)
        tag.unlink(missing_ok=True)
        part.replace(target)

    pooch.get_logger().setLevel("WARNING")
    try:
        return Path(pooch.retrieve(file.url, file.sha256, file.name, directory, downloader=resume))
    except httpx.HTTPError as error:
        kept = f" after {part.stat().st_size:,} bytes; run it again to go on" if part.exists() else ""
        raise FetchError(f"{file.url} broke off{kept}: {error or type(error).__name__}.") from None
    except ValueError as error:  # the first of pooch's sentences names both checksums
        raise FetchError(f"{file.url} was not kept: {str(error).partition('. ')[0]}.") from None


def _transfer(url: str, part: Path, tag: Path, client: httpx.Client, progress: Progress) -> None:
    """Make the part complete."""
    have = part.stat().st_size if part.exists() and tag.exists() else 0
    headers = {"Accept-Encoding": "identity"}  # ranges and checksums are of the file itself
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": tag.read_text("ascii")}
    with client.stream("GET", url, headers=headers, follow_redirects=True) as response:
        match response.status_code:
            case 200:  # all of it: the first try, or the server does no ranges, or has a newer version
                _store(response, part, tag, 0, progress)
                return
            case 206 if response.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                _store(response, part, tag, have, progress)
                return
            case 416 if have:  # the part is at least as long as the file: it cannot be resumed
                part.unlink()
            case _:
                raise FetchError(f"{url} was answered with {response.status_code} {response.reason_phrase}.")
    _transfer(url, part, tag, client, progress)


def _store(response: httpx.Response, part: Path, tag: Path, have: int, progress: Progress) -> None:
    """Append to the `have` bytes of the part, or start it."""
    version = response.headers.get("ETag", "")
    if version.startswith('"') and version.isascii():  # a weak tag, W/"…", does not promise equal bytes
        tag.write_text(version, "ascii")
    else:
        tag.unlink(missing_ok=True)
    length = response.headers.get("Content-Length", "")
    total = have + int(length) if re.fullmatch("[0-9]{1,15}", length) else None
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
        raise FetchError(f"{response.url} is larger than {MAX_BYTES // 1_000_000} MB, so it was dropped.")
