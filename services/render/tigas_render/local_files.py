"""This user's files outside of the models directory: the cache, keys, and temporary directories."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path

from tigas_common.files import read_regular

logger = logging.getLogger(__name__)

KEY_LENGTH = 32
"""Bytes."""
YOUNG_S = 10.0
"""Seconds after its creation for which a directory may not be locked yet."""


def cache_directory() -> Path:
    """Directory for reproducible data of this user's programs (XDG base directories)."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tigas"


def kept_key(path: Path) -> bytes:
    """The secret in a file private to this user, created if missing; an unusable one is replaced."""
    key = os.urandom(KEY_LENGTH)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
            file.write(key)
    except FileExistsError:
        with suppress(OSError):
            kept = read_regular(path, KEY_LENGTH)
            return kept if len(kept) == KEY_LENGTH else key
    except OSError:
        pass
    return key


def write_to_cache(path: Path, content: bytes | Callable[[Path], object]) -> None:
    """Write a file atomically, so that no reader sees a partial one. Failing to write is not an error.

    content: or a function that writes it to a path, which raises OSError.
    """
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, bytes):
            temporary.write_bytes(content)
        else:
            content(temporary)
        temporary.replace(path)
    except OSError as error:
        logger.warning("The cache %s cannot be written: %s", path.parent, error.strerror or error)
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def locked_directory(parent: Path, prefix: str) -> Iterator[Path]:
    """A new directory private to this user, locked by a context manager.

    It is removed even if the process is killed: the next one removes the abandoned directories with the same prefix,
    which belongs to one program alone. Raises OSError.
    """
    _remove_abandoned(parent, prefix)
    with (
        tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True) as name,  # mode 0700
        locked(Path(name)),
    ):
        yield Path(name)


def _remove_abandoned(parent: Path, prefix: str) -> None:
    """Remove the directories of this user's killed processes: the kernel releases a lock with its process."""
    for path in parent.glob(f"{prefix}*"):
        with (
            suppress(OSError),
            locked(path, LOCK_EX | LOCK_NB) as status,
        ):  # another user's, locked, or already removed
            if status.st_uid == os.getuid() and abs(time.time() - status.st_mtime) > YOUNG_S:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def locked(path: Path, how: int = LOCK_EX) -> Iterator[os.stat_result]:
    """A directory's state, while other processes and threads that lock it are excluded.

    Raises OSError, also if `how` is not to wait and it is locked already.
    """
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        flock(fd, how)
        yield os.fstat(fd)
    finally:
        os.close(fd)
