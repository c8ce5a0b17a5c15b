"""Files on their way to the models directory: what has come of each lies in a hidden folder there.

All that is known of them is on the disk, so that every process of the service may take any part of any of them.
Everything here blocks.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import BodyTooLarge, Overloaded, TigasError
from tigas_common.files import check_room, storage_explained

FOLDER = ".uploads"
"""In the models directory; no scan looks into it."""
MOST = 8
"""Unfinished uploads at a time."""
IDLE_S = 3600.0
"""An upload of which nothing comes for so long is given up, in seconds."""
RETRY_S = 60.0
MODELS = "models"
_ID = re.compile("[0-9a-f]{32}")
_ABOUT, _ADDED = ".about", ".added"
"""No scene is called so, and the file is called as its scene is to be: that is how sentences about it name it."""


class UnknownUpload(TigasError):
    """There is no such upload, or it was given up."""

    status, type, title = 404, "unknown-upload", "There is no such upload"


class WrongOffset(TigasError):
    """What comes does not begin where the rest is missing."""

    status, type, title = 409, "wrong-offset", "The upload goes on elsewhere"


@dataclass(frozen=True, slots=True)
class Upload:
    """One file on its way."""

    id: str
    scene: str
    """What it is to be called."""
    length: int
    """Bytes."""
    offset: int
    """How many of them are here."""
    path: Path
    """Where they are."""
    added: bool
    """Whether it is a scene now; then they are here no longer."""


class Uploads:
    """All that are on their way to one models directory."""

    def __init__(self, models: Path, limit: int, clock: Callable[[], float] = time.time) -> None:
        """limit: of a file, in bytes; clock: seconds since 1970, as files have them."""
        self.models = models
        self.limit = limit
        self._root = models / FOLDER
        self._clock = clock

    def create(self, scene: str, length: int) -> Upload:
        """Begin one. Raises BodyTooLarge, Overloaded if there are too many, DiskFull and StorageFailed."""
        if length > self.limit:
            raise BodyTooLarge(f"The file has {_gb(length)}; this service takes up to {_gb(self.limit)}.")
        with storage_explained(MODELS):
            self._root.mkdir(exist_ok=True)
            with self._alone():
                self.expire()
                others = [each for each in self._all() if not each.added]
                if len(others) >= MOST:
                    raise Overloaded(f"{MOST} files are being uploaded already; try again later.", RETRY_S)
                check_room(self._root, length + sum(each.length - each.offset for each in others))
                folder = self._root / secrets.token_hex(16)
                folder.mkdir()
                (folder / _ABOUT).write_text(json.dumps({"scene": scene, "length": length}))
                (folder / scene).touch()
        return self.get(folder.name)

    def get(self, id: str) -> Upload:
        """How far one is. Raises UnknownUpload."""
        folder = self._folder(id)
        try:
            about = json.loads((folder / _ABOUT).read_text())
            added = (folder / _ADDED).exists()
            path = folder / about["scene"]
            offset = about["length"] if added else path.stat().st_size
        except (OSError, ValueError):
            raise UnknownUpload("There is no such upload; it may have been given up.") from None
        return Upload(id, about["scene"], about["length"], offset, path, added)

    def append(self, id: str, offset: int, part: bytes) -> None:
        """Write what comes next, of whichever request that is: of two, the one that is late is refused.

        Raises UnknownUpload, WrongOffset, BodyTooLarge, DiskFull and StorageFailed.
        """
        upload = self.get(id)
        if offset + len(part) > upload.length:
            raise BodyTooLarge(f"This is more than the {upload.length} bytes that the upload was to have.")
        with storage_explained(MODELS), upload.path.open("r+b", buffering=0) as file:
            check_room(self._root, len(part))
            fcntl.flock(file, fcntl.LOCK_EX)
            has = file.seek(0, os.SEEK_END)
            if has != offset:
                raise WrongOffset(f"The upload has {has} bytes, and this would go on at {offset}.")
            rest = memoryview(part)
            while rest:
                rest = rest[file.write(rest) :]

    def note_added(self, upload: Upload) -> None:
        """Remember for a while that it is a scene: whoever did not hear it asks again. Raises StorageFailed."""
        with storage_explained(MODELS):
            (self._folder(upload.id) / _ADDED).touch()

    def discard(self, id: str) -> None:
        """Give one up. Raises UnknownUpload."""
        shutil.rmtree(self.get(id).path.parent, ignore_errors=True)

    def expire(self) -> None:
        """Give up those of which nothing comes any more."""
        for folder in self._folders():
            with suppress(OSError):
                newest = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
                if self._clock() - newest > IDLE_S:
                    shutil.rmtree(folder, ignore_errors=True)

    def _folder(self, id: str) -> Path:
        if not _ID.fullmatch(id):
            raise UnknownUpload("There is no such upload.")
        return self._root / id

    def _folders(self) -> list[Path]:
        try:
            return [path for path in self._root.iterdir() if _ID.fullmatch(path.name)]
        except OSError:
            return []

    def _all(self) -> Iterator[Upload]:
        for folder in self._folders():
            with suppress(UnknownUpload):
                yield self.get(folder.name)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """In all processes, one after the other."""
        folder = os.open(self._root, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)


def _gb(size: int) -> str:
    return f"{size / 1e9:.3g} GB"
