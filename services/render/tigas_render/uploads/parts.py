"""Files being uploaded to the models directory. The received part of each is in a hidden folder there.

All state is on disk, so that every process of the service can accept any part of any upload. All calls block.
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
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import BodyTooLarge, Overloaded, TigasError
from tigas_common.files import check_free_space, storage_errors
from tigas_render.local_files import lock_directory
from tigas_render.settings import RenderSettings

FOLDER_NAME = ".uploads"
"""Name of the folder in the models directory, which scans ignore."""
MAX_UPLOADS, MAX_PER_ADDRESS = 8, 4
"""Maximum number of concurrent uploads, in total and per address."""
IDLE_S = 3600.0
"""Seconds without data after which an upload is dropped."""
STALLED_S = 300.0
"""Seconds without data after which an upload loses its slot and reserved disk space; an empty one is dropped."""
RETRY_S = 60.0
MODELS = "models"
EDITING_FORBIDDEN = "Pages may not change this service's scenes; outside a cluster, --edit-scenes allows it."
_ID = re.compile("[0-9a-f]{32}")
_METADATA_FILE, _ADDED_FILE = ".about", ".added"
"""Other files in an upload's folder. The uploaded file is called like its future scene, as error messages name it."""


class ScenesReadOnly(TigasError):
    """Pages may not change this service's scenes."""

    status, type, title = 403, "scenes-fixed", "Scenes cannot be changed here"


class UnknownUpload(TigasError):
    """The upload does not exist, or has been discarded."""

    status, type, title = 404, "unknown-upload", "There is no such upload"


class WrongOffset(TigasError):
    """The received part does not start at the end of the previous ones."""

    status, type, title = 409, "wrong-offset", "The upload continues at another offset"


@dataclass(frozen=True, slots=True)
class Upload:
    """A file being uploaded."""

    id: str
    scene: str
    """Id of the future scene, and name of the file."""
    length: int
    """Total size in bytes."""
    offset: int
    """Number of bytes received."""
    path: Path
    """Path of the received part."""
    added: bool
    """Whether the file has become a scene, and has been moved away."""
    address: str
    """Address of the client that started the upload."""


class Uploads:
    """All uploads to a models directory."""

    def __init__(self, models: Path, limit: int, clock: Callable[[], float] = time.time) -> None:
        """limit: maximum size of a file in bytes. clock: seconds since 1970, like the times of files."""
        self.models = models
        self.limit = limit
        self._root = models / FOLDER_NAME
        self._clock = clock

    def create(self, scene: str, length: int, address: str) -> Upload:
        """Start an upload. Raises BodyTooLarge, Overloaded if there are too many, DiskFull and StorageFailed."""
        if length > self.limit:
            raise BodyTooLarge(f"The file has {_gb(length)}; this service accepts up to {_gb(self.limit)}.")
        with storage_errors(MODELS):
            self._root.mkdir(exist_ok=True)
            with lock_directory(self._root):
                self.expire()
                others = [
                    each for each in self._all() if not each.added and not self._is_idle(each.path.parent, STALLED_S)
                ]
                if len(others) >= MAX_UPLOADS:
                    raise Overloaded(f"{MAX_UPLOADS} files are being uploaded already; try again later.", RETRY_S)
                if sum(each.address == address for each in others) >= MAX_PER_ADDRESS:
                    raise Overloaded(
                        f"{MAX_PER_ADDRESS} files are being uploaded from this address already; try again later.",
                        RETRY_S,
                    )
                check_free_space(self._root, length + sum(each.length - each.offset for each in others))
                folder = self._root / secrets.token_hex(16)
                folder.mkdir()
                (folder / _METADATA_FILE).write_text(json.dumps({"scene": scene, "length": length, "address": address}))
                (folder / scene).touch()
        return self.get(folder.name)

    def get(self, id: str) -> Upload:
        """The state of an upload. Raises UnknownUpload."""
        folder = self._folder(id)
        try:
            about = json.loads((folder / _METADATA_FILE).read_text())
            path = folder / about["scene"]
            added = not path.exists() and (folder / _ADDED_FILE).exists()
            offset = about["length"] if added else path.stat().st_size
        except (OSError, ValueError):
            raise UnknownUpload("There is no such upload; it may have expired.") from None
        return Upload(id, about["scene"], about["length"], offset, path, added, about.get("address", ""))

    def append(self, id: str, offset: int, part: bytes) -> None:
        """Append a part. Of two concurrent requests, the later one is refused.

        Raises UnknownUpload, WrongOffset, BodyTooLarge, DiskFull and StorageFailed.
        """
        upload = self.get(id)
        if offset + len(part) > upload.length:
            raise BodyTooLarge(f"This is more than the {upload.length} bytes announced for the upload.")
        with storage_errors(MODELS), upload.path.open("r+b", buffering=0) as file:
            check_free_space(self._root, len(part))
            fcntl.flock(file, fcntl.LOCK_EX)
            has = file.seek(0, os.SEEK_END)
            if has != offset:
                raise WrongOffset(f"The upload has {has} bytes, but this part begins at {offset}.")
            rest = memoryview(part)
            while rest:
                rest = rest[file.write(rest) :]

    def mark_added(self, upload: Upload) -> None:
        """Note that the file is about to be moved, after which the upload counts as added. Raises OSError."""
        (self._folder(upload.id) / _ADDED_FILE).touch()

    def lock(self, upload: Upload) -> AbstractContextManager[object]:
        """Prevent other processes from checking an upload, as a context manager. Raises OSError."""
        return lock_directory(self._folder(upload.id))

    def discard(self, id: str) -> None:
        """Discard an upload. Raises UnknownUpload."""
        shutil.rmtree(self.get(id).path.parent, ignore_errors=True)

    def expire(self) -> None:
        """Drop stalled uploads."""
        for folder in self._folders():
            if self._is_idle(folder, IDLE_S):
                shutil.rmtree(folder, ignore_errors=True)
        for each in self._all():
            if not each.offset and self._is_idle(each.path.parent, STALLED_S):
                shutil.rmtree(each.path.parent, ignore_errors=True)

    def _is_idle(self, folder: Path, seconds: float) -> bool:
        """Whether an upload's folder has been unchanged for this long."""
        try:
            newest = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
        except OSError:
            return False
        return self._clock() - newest > seconds

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


def _gb(size: int) -> str:
    return f"{size / 1e9:.3g} GB"


def open_uploads(settings: RenderSettings) -> Uploads:
    """The uploads to the models directory, if pages may change it. Raises ScenesReadOnly."""
    if not settings.pages_edit_scenes:
        raise ScenesReadOnly(EDITING_FORBIDDEN)
    if not os.access(settings.scenes, os.W_OK | os.X_OK):
        raise ScenesReadOnly("The service may not write to its models directory.")
    return Uploads(settings.scenes, limit=int(settings.memory_gb * 1e9))
