"""Opens files that others may have put somewhere, if they are files: a pipe or a device may never end."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from tigas_common.errors import DiskFull, StorageFailed

SPARE_BYTES = 1 << 30
"""Of a disk, that large files leave."""


def open_regular(path: Path, *, follow: bool = True) -> BufferedReader:
    """Open a file to read, through links unless told otherwise.

    Raises OSError, also for a pipe, a socket, a device or a folder, and for a link that is not to be followed.
    """
    opener = _open if follow else _open_itself
    file = open(path, "rb", opener=opener)  # noqa: SIM115 - the caller's to close
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return file


def read_regular(path: Path, limit: int, *, follow: bool = True) -> bytes:
    """All of a file. Raises OSError as `open_regular` does, and if it has more than `limit` bytes."""
    with open_regular(path, follow=follow) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
        return file.read(size)  # memory for all that it asks for is taken at once


def check_room(directory: Path, needed: int) -> None:
    """Whether a directory's disk takes so many bytes more, and keeps some. Raises OSError."""
    if needed > shutil.disk_usage(directory).free - SPARE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(directory))


@contextmanager
def storage_explained(what: str) -> Iterator[None]:
    """Turns the system's errors into DiskFull and StorageFailed; `what` is kept."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull(f"The disk that holds the {what} is full.") from None
        raise StorageFailed(f"The disk that holds the {what} refused: {error.strerror or error}.") from error


def _open(path: str, flags: int) -> int:
    """Without waiting for a writer, and so that no terminal becomes this process' own."""
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def _open_itself(path: str, flags: int) -> int:
    return _open(path, flags | os.O_NOFOLLOW)
