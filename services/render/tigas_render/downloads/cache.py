"""A cache of scenes' downloadable files: each is made once, and the least recently used are removed to make room.

Each file's metadata is written last, as JSON next to it, so a file without metadata is incomplete. Several processes
may share the directory. Files are sent whole or in ranges, to a limited number of clients at a time.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from tigas_common.address import client_network
from tigas_common.errors import BrokenScene, InvalidRequest, Overloaded, TigasError
from tigas_common.limits import ConcurrencyLimit
from tigas_common.parsing import parse
from tigas_common.web import is_not_modified
from tigas_common.wire.render import SceneDownload
from tigas_render.downloads.order import download_order
from tigas_render.local_files import write_to_cache
from tigas_render.scenes.compressed_ply import write_compressed_ply
from tigas_render.scenes.ply import ANTIALIASED
from tigas_render.scenes.source import SceneSource
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.scenes.streamed_sog import FORMAT, find_streamable_file
from tigas_render.single_flight import SingleFlight

_log = logging.getLogger(__name__)

VERSION = 2
"""Version of the files; increment it when their content changes, so that old cached files are not used."""
METADATA_SUFFIX = ".json"
"""Suffix of a metadata file."""
MAX_DOWNLOADS, MAX_DOWNLOADS_PER_ADDRESS = 128, 32
"""Concurrent answers, in total and per address. Each holds a connection and an open file until it has been read."""
ABANDONED_S = 600.0
"""Age in seconds above which an unfinished file counts as abandoned."""
RETRY_S = 5.0
Check = Callable[[], None]
"""Raises Overloaded once the service is stopping."""
WriteDownload = Callable[[SceneSource, Path, Check], SceneDownload]
"""Writes a scene's file. Raises BrokenScene, Overloaded and OSError."""


class UnknownDownload(TigasError):
    """The server does not offer this download, or any."""

    status, type, title = 404, "unknown-download", "There is no such download"


class NoSpace(TigasError):
    """The file cannot be stored."""

    status, type, title = 507, "no-space", "There is no space for the file"


@dataclass(frozen=True, slots=True)
class DownloadFile:
    """A file that can be downloaded."""

    path: Path
    metadata: SceneDownload


def write_download(source: SceneSource, path: Path, check: Check) -> SceneDownload:
    """Write a scene's file, with all of the scene in memory.

    Raises BrokenScene, the errors of `check`, and OSError if the file cannot be written.
    """
    gaussians = source.read(lambda _: check()).read_all()
    camera = SceneStatistics.of(gaussians).view(source.metadata).camera
    order = download_order(gaussians, camera.position, check)
    comments = [*(part.comment for part in order.parts), *([ANTIALIASED] if gaussians.antialiased else ())]
    write_compressed_ply(path, gaussians, order.indices, comments, check=check)
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return SceneDownload(bytes=path.stat().st_size, sha256=sha256, gaussians=len(gaussians))


class DownloadCache:
    """Files in `directory`, of at most `limit` bytes in total. With a limit of 0, no downloads are offered."""

    def __init__(self, directory: Path, limit: int, write_download: WriteDownload = write_download) -> None:
        self._directory = directory
        self._limit = limit
        self._write_download = write_download
        self._requests = SingleFlight[Path, DownloadFile]()
        self._make_lock = asyncio.Lock()  # so that only one scene at a time is in memory for this
        self._closed = False

    def close(self) -> None:
        """Abort the files being made, because the service is stopping."""
        self._closed = True

    def available(self, source: SceneSource) -> tuple[SceneDownload, ...]:
        """The downloadable forms of a scene, with metadata for a file that has been made. Reads files."""
        if not self._limit or source.open is None:
            return ()
        whole = _read_metadata(self._path(source)) or SceneDownload()
        if source.format != FORMAT:
            return (whole,)
        return whole, SceneDownload(form="streamed", gaussians=source.gaussians)

    def streamed_file(self, source: SceneSource, name: str) -> tuple[Path, str]:
        """A file of a streamed scene, and its version. Raises UnknownDownload."""
        if self._limit and source.folder is not None and source.format == FORMAT:
            with contextlib.suppress(OSError):  # removed in the meantime, or its name is too long
                if (path := find_streamable_file(source.folder, name)) is not None:
                    status = path.stat()
                    return path, f"{status.st_mtime_ns:x}-{status.st_size:x}"
        raise UnknownDownload(f"{source.name} has no file {name[:100]!r} to stream.")

    async def get(self, source: SceneSource) -> DownloadFile:
        """A scene's file, made once for concurrent first requests.

        Raises UnknownDownload, BrokenScene, NoSpace if the file does not fit on the disk or under the limit, and
        Overloaded if the service is stopping.
        """
        if not self._limit:
            raise UnknownDownload(f"{source.name} is not offered for download.")
        if source.open is None:
            raise BrokenScene(source.error or f"{source.name} cannot be loaded.")
        path = self._path(source)
        return await self._requests.get(path, lambda: self._get_or_make(source, path))

    def _path(self, source: SceneSource) -> Path:
        """The cache file, whose name depends on everything that its content depends on."""
        key = f"{VERSION}|{source.id}|{source.version}|{source.metadata.appearance_key}"
        return self._directory / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.compressed"

    async def _get_or_make(self, source: SceneSource, path: Path) -> DownloadFile:
        about = await asyncio.to_thread(_touch, path)
        if about is None:
            async with self._make_lock:
                about = await asyncio.to_thread(self._write, source, path)
        return DownloadFile(path, about)

    def _check_open(self) -> None:
        if self._closed:
            raise Overloaded("The download was not made, as the service is stopping.", RETRY_S)

    def _write(self, source: SceneSource, path: Path) -> SceneDownload:
        temporary = path.with_suffix(f"{path.suffix}.{os.getpid()}.tmp")
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            about = self._write_download(source, temporary, self._check_open)
            size = temporary.stat().st_size
            if size > self._limit:
                raise NoSpace(
                    f"{source.name} takes {size / 1e6:.1f} MB as a download, and all together may take"
                    f" {self._limit / 1e6:.1f} MB."
                )
            self._evict(size, temporary)
            temporary.replace(path)
        except OSError as error:
            reason = error.strerror or error
            raise NoSpace(f"The server cannot store {source.name} as a download: {reason}.") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()
        write_to_cache(_metadata_path(path), about.model_dump_json().encode())
        _log.info("Made %s for download: %d Gaussians, %.1f MB", source.id, about.gaussians, size / 1e6)
        return about

    def _evict(self, needed: int, spared: Path) -> None:
        """Remove the least recently used files, without affecting open readers. Raises OSError."""
        used = []
        for path in self._directory.iterdir():
            with contextlib.suppress(FileNotFoundError):  # finished or removed by another process
                stat = path.stat()
                being_made = path.suffix == ".tmp" and time.time() - stat.st_mtime < ABANDONED_S
                if path != spared and path.suffix != METADATA_SUFFIX and not being_made:
                    used.append((stat.st_atime_ns, stat.st_size, path))
        used.sort()
        excess = sum(size for _, size, _ in used) + needed - self._limit
        for _, size, path in used:
            if excess <= 0:
                return
            for gone in (_metadata_path(path), path):
                gone.unlink(missing_ok=True)
            excess -= size


def _metadata_path(path: Path) -> Path:
    return path.with_suffix(path.suffix + METADATA_SUFFIX)


def _touch(path: Path) -> SceneDownload | None:
    """Like `_read_metadata`, but also marks the file as most recently used, by its access time."""
    with contextlib.suppress(OSError):
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
    return _read_metadata(path)


def _read_metadata(path: Path) -> SceneDownload | None:
    """Metadata of a file; None if it is missing or incomplete."""
    try:
        about = parse(SceneDownload, _metadata_path(path).read_bytes())
        return about if path.stat().st_size == about.bytes else None
    except (OSError, InvalidRequest):
        return None


class FileSender:
    """Answers requests with files, up to a limit of concurrent answers."""

    def __init__(self) -> None:
        self.limit = ConcurrencyLimit(MAX_DOWNLOADS, MAX_DOWNLOADS_PER_ADDRESS)

    def response(self, request: Request, path: Path, version: str | None, **options: Any) -> Response:
        """Answer with a file, or a range of it, or 304. Sending the answer raises Overloaded beyond the limit."""
        headers = {
            "ETag": f'"{version}"',
            "Cache-Control": "no-cache",
            "Timing-Allow-Origin": "*",  # lets a page of another origin see how much was transferred
        }
        if is_not_modified(request, headers["ETag"]):
            return Response(status_code=304, headers=headers)
        return _LimitedFileResponse(self.limit, path, headers=headers, **options)


class _LimitedFileResponse(FileResponse):
    """A file response that counts towards the limit until its client has read it."""

    chunk_size = 256 * 1024

    def __init__(self, limit: ConcurrencyLimit, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        busy = Overloaded("Too many scenes are being downloaded; try again in a few seconds.", RETRY_S)
        with self._limit.acquire(client_network(client[0]) if client else "unknown", busy):
            await super().__call__(scope, receive, send)
