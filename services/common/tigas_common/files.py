"""Safe file access: reads only regular files, as a pipe or device may never end, and writes atomically and durably."""

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
"""Disk space that large files must leave free."""
NO_SPACE = {errno.ENOSPC, errno.EDQUOT}
NO_HARD_LINKS = {errno.EPERM, errno.EMLINK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of file systems without hard links."""


NOBODY = 65534
"""The system's unprivileged user."""


def open_regular(path: Path, *, follow: bool = True) -> BufferedReader:
    """Open a regular file for reading, following links by default.

    Raises OSError, also for a pipe, a socket, a device or a folder, and for a link if `follow` is false.
    """
    opener = _open if follow else _open_no_follow
    file = open(path, "rb", opener=opener)  # noqa: SIM115 - the caller's to close
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return file


def read_regular(path: Path, limit: int, *, follow: bool = True) -> bytes:
    """Read a whole file. Raises OSError as `open_regular` does, and if the file has more than `limit` bytes."""
    with open_regular(path, follow=follow) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
        return file.read(size)  # `read` allocates all of this at once


def check_free_space(directory: Path, needed: int) -> None:
    """Check that a disk has room for this many bytes and a reserve. Raises OSError."""
    if needed > shutil.disk_usage(directory).free - SPARE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(directory))


def flush_tree(path: Path) -> None:
    """Flush a file, or a folder with its contents, so that it survives a power failure. Raises OSError."""
    inside = (Path(parent, name) for parent, folders, names in os.walk(path) for name in (*names, *folders))
    for each in (*inside, path):
        handle = os.open(each, os.O_RDONLY | os.O_NOFOLLOW)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def move_new(source: Path, target: Path) -> None:
    """Move a file, link or folder to an unused name on the same disk, atomically and durably.

    Raises OSError, such as FileExistsError if the name is taken; nothing has changed then.
    """
    if stat.S_ISDIR(source.lstat().st_mode):
        source.rename(target)
    else:
        try:
            os.link(source, target, follow_symlinks=False)
        except OSError as error:
            if error.errno not in NO_HARD_LINKS:
                raise
            _replace_placeholder(source, target)
        else:
            source.unlink()
    flush_folder(target.parent)


def replace_file(path: Path, content: bytes) -> None:
    """Replace a file atomically and durably. Raises OSError, and then the old file is intact."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        flush_tree(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    flush_folder(path.parent)


def change_owner(folder: Path, uid: int, gid: int) -> None:
    """Make a user the owner of a folder and of everything in it that belongs to root or nobody. Raises OSError.

    Files with several hard links are left alone, as they may also be elsewhere.
    """
    for _, folders, files, parent in os.fwalk(folder):  # works on descriptors, so that links cannot interfere
        for name in (".", *folders, *files):
            state = os.stat(name, dir_fd=parent, follow_symlinks=False)
            has_one_name = stat.S_ISDIR(state.st_mode) or state.st_nlink == 1
            if has_one_name and state.st_uid in (0, NOBODY):
                os.chown(name, uid, gid, dir_fd=parent, follow_symlinks=False)


def change_owner_to_caller(folder: Path) -> None:
    """Make the user that invoked sudo, if any, the owner of a folder written by a command. Raises OSError."""
    if "SUDO_UID" in os.environ:
        change_owner(folder, int(os.environ["SUDO_UID"]), int(os.environ["SUDO_GID"]))


@contextmanager
def storage_errors(what: str) -> Iterator[None]:
    """Turn OSErrors into DiskFull and StorageFailed; `what` names the stored data."""
    try:
        yield
    except OSError as error:
        if error.errno in NO_SPACE:
            raise DiskFull(f"The disk that holds the {what} is full.") from None
        raise StorageFailed(f"The disk that holds the {what} reported an error: {error.strerror or error}.") from error


def _replace_placeholder(source: Path, target: Path) -> None:
    target.open("x").close()
    try:
        source.replace(target)
    except BaseException:
        target.unlink()
        raise


def flush_folder(folder: Path) -> None:
    """Flush a folder's entries. Some network file systems cannot, and need not: they persist them anyway."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def _open(path: str, flags: int) -> int:
    """Open without waiting for a pipe's writer and without acquiring a controlling terminal."""
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)


def _open_no_follow(path: str, flags: int) -> int:
    return _open(path, flags | os.O_NOFOLLOW)
