"""Keeps the files that scenes are downloaded as: each is made once, and the longest unused go when room is needed.

Beside each file lies what is known of it, as JSON, which is written last: a file without it is not complete. Several
processes may share the directory.
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

from tigas_common.errors import BrokenScene, InvalidRequest, TigasError
from tigas_common.parsing import parse
from tigas_common.wire.render import DownloadForm, SceneDownload
from tigas_render.cache import write_to_cache
from tigas_render.downloads.files import FORMS, VERSION, make
from tigas_render.once import Once
from tigas_render.scenes.source import SceneSource

_log = logging.getLogger(__name__)

CARD = ".json"
"""How the name of what is known of a file ends."""
Make = Callable[[SceneSource, DownloadForm, Path], SceneDownload]
"""Writes a scene's file in a form. Raises BrokenScene and OSError."""


class NoSuchDownload(TigasError):
    """The scene is not offered in this form."""

    status, type, title = 404, "unknown-download", "There is no such download"


class NoSpace(TigasError):
    """The file cannot be kept."""

    status, type, title = 507, "no-space", "There is no room for the file"


@dataclass(frozen=True, slots=True)
class MadeFile:
    """A file that can be downloaded."""

    path: Path
    about: SceneDownload


class DownloadCache:
    """Files in `directory`, of at most `limit` bytes together; with a limit of 0 nothing is offered."""

    def __init__(self, directory: Path, limit: int, make: Make = make) -> None:
        self._directory = directory
        self._limit = limit
        self._make = make
        self._making = Once[Path, MadeFile]()
        self._turns = asyncio.Lock()  # one scene at a time is in memory for it

    def offered(self, source: SceneSource) -> tuple[SceneDownload, ...]:
        """In which forms a scene can be downloaded, and what is known of the files that are made. Reads files."""
        if not self._limit or source.open is None:
            return ()
        return tuple(_about(self._path(source, form)) or SceneDownload(form=form) for form in FORMS)

    async def get(self, source: SceneSource, form: str) -> MadeFile:
        """A scene's file; concurrent first requests make it once.

        Raises NoSuchDownload, BrokenScene, and NoSpace if the file does not fit on the disk or under the limit.
        """
        known = next((each for each in FORMS if each == form), None)
        if known is None or not self._limit:
            raise NoSuchDownload(f"{source.name} is not offered as {form[:40]!r}.")
        if source.open is None:
            raise BrokenScene(source.error or f"{source.name} cannot be loaded.")
        path = self._path(source, known)
        return await self._making.get(path, lambda: self._kept_or_made(source, known, path))

    def _path(self, source: SceneSource, form: DownloadForm) -> Path:
        """The file's name depends on everything that its content depends on."""
        key = f"{VERSION}|{source.id}|{source.version}|{source.metadata.model_dump_json()}"
        return self._directory / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.{form}"

    async def _kept_or_made(self, source: SceneSource, form: DownloadForm, path: Path) -> MadeFile:
        about = await asyncio.to_thread(_used, path)
        if about is None:
            async with self._turns:
                about = await asyncio.to_thread(self._make_and_keep, source, form, path)
        return MadeFile(path, about)

    def _make_and_keep(self, source: SceneSource, form: DownloadForm, path: Path) -> SceneDownload:
        temporary = path.with_suffix(f"{path.suffix}.{os.getpid()}.tmp")
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            about = self._make(source, form, temporary)
            size = temporary.stat().st_size
            if size > self._limit:
                raise NoSpace(
                    f"{source.name} takes {size / 1e6:.1f} MB as a download, and all together may take"
                    f" {self._limit / 1e6:.1f} MB."
                )
            self._make_room(size, temporary)
            temporary.replace(path)
        except OSError as error:
            reason = error.strerror or error
            raise NoSpace(f"The server cannot keep {source.name} as a download: {reason}.") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()
        write_to_cache(_card(path), about.model_dump_json().encode())
        _log.info("Made %s as %s: %d Gaussians, %.1f MB", source.id, form, about.gaussians, size / 1e6)
        return about

    def _make_room(self, needed: int, spared: Path) -> None:
        """Remove the longest unused files; who reads one reads on. Raises OSError."""
        others = [path for path in self._directory.iterdir() if path != spared and path.suffix != CARD]
        used = sorted((path.stat().st_atime_ns, path.stat().st_size, path) for path in others)
        excess = sum(size for _, size, _ in used) + needed - self._limit
        for _, size, path in used:
            if excess <= 0:
                return
            for gone in (_card(path), path):
                gone.unlink(missing_ok=True)
            excess -= size


def _card(path: Path) -> Path:
    return path.with_suffix(path.suffix + CARD)


def _used(path: Path) -> SceneDownload | None:
    """As `_about`; a file that there is becomes the last used, which its time of access says."""
    with contextlib.suppress(OSError):
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
    return _about(path)


def _about(path: Path) -> SceneDownload | None:
    """What is known of a complete file; None if there is none."""
    try:
        about = parse(SceneDownload, _card(path).read_bytes())
        return about if path.stat().st_size == about.bytes else None
    except (OSError, InvalidRequest):
        return None
