"""Downloads of published files: verified, limited in size, and resumed after an interruption."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import httpx
import pooch

from tigas_common.errors import TigasError

Progress = Callable[[int, int | None], None]
"""Progress callback: bytes received so far and, if the server announces it, the total."""


class FetchError(TigasError):
    status, type, title = 502, "fetch-failed", "The data cannot be fetched"


def download(
    url: str, sha256: str | None, path: Path, most_bytes: int, client: httpx.Client, progress: Progress
) -> Path:
    """Download a file to `path` unless it is already there and unchanged. Raises FetchError and OSError.

    An incomplete file is called NAME.part, and NAME.part.tag holds the server's ETag for it: a download is resumed only
    if the server still has that version.
    """
    part, tag = path.with_name(f"{path.name}.part"), path.with_name(f"{path.name}.part.tag")

    def resume(url: str, target: str, _: object) -> None:
        _transfer(url, part, tag, most_bytes, client, progress)
        tag.unlink(missing_ok=True)
        part.replace(target)

    pooch.get_logger().setLevel("WARNING")
    try:
        return Path(pooch.retrieve(url, sha256, path.name, path.parent, downloader=resume))
    except httpx.HTTPError as error:
        kept = (
            f" after {part.stat().st_size:,} bytes; run it again to continue" if part.exists() and tag.exists() else ""
        )
        raise FetchError(f"{url} broke off{kept}: {str(error) or type(error).__name__}.") from None
    except ValueError as error:  # the first sentence of pooch's message names both checksums
        raise FetchError(f"{url} was not kept: {str(error).partition('. ')[0]}.") from None


def _transfer(url: str, part: Path, tag: Path, most_bytes: int, client: httpx.Client, progress: Progress) -> None:
    """Download the rest of the part."""
    have = part.stat().st_size if part.exists() and tag.exists() else 0
    headers = {"Accept-Encoding": "identity"}  # ranges and checksums must refer to the file itself
    if have:
        headers |= {"Range": f"bytes={have}-", "If-Range": tag.read_text("ascii")}
    with client.stream("GET", url, headers=headers, follow_redirects=True) as response:
        match response.status_code:
            case 200:  # the whole file: a first try, a server without ranges, or a newer version
                _store(response, part, tag, 0, most_bytes, progress)
                return
            case 206 if response.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                _store(response, part, tag, have, most_bytes, progress)
                return
            case 416 if have:  # the part is at least as long as the file, so it cannot be resumed
                part.unlink()
            case _:
                raise FetchError(f"{url} was answered with {response.status_code} {response.reason_phrase}.")
    _transfer(url, part, tag, most_bytes, client, progress)


def _store(response: httpx.Response, part: Path, tag: Path, have: int, most_bytes: int, progress: Progress) -> None:
    """Append to the `have` bytes of the part, or start a new one."""
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
            if have > most_bytes:
                break
            out.write(chunk)
            progress(have, total)
    if have > most_bytes:
        part.unlink()
        tag.unlink(missing_ok=True)
        raise FetchError(f"{response.url} has more than {most_bytes:,} bytes, so it was discarded.")
