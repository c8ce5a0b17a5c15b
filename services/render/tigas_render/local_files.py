"""The user's files outside the models directory: the cache, keys, and temporary directories."""

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
"""Length of a key in bytes."""
MIN_AGE_S = 10.0
"""Seconds after its creation in which a directory may not be locked yet."""


def cache_directory() -> Path:
    """The user's directory for reproducible data (XDG base directories)."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tigas"


def load_or_create_key(path: Path) -> bytes:
    """The secret in a private file of the user, created if missing. If that fails, a secret that is not stored."""
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
    """Write a file atomically, so that no reader sees a partial one. A failure is logged and otherwise ignored.

    content: bytes, or a function that writes the content to a path and may raise OSError.
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
    """Create a private directory, and lock it as a context manager.

    It is removed even if the process is killed, because the next call removes abandoned directories with the same
    prefix, which must be unique to the program. Raises OSError.
    """
    _remove_abandoned(parent, prefix)
    with (
        tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True) as name,  # mode 0700
        lock_directory(Path(name)),
    ):
        yield Path(name)


def _remove_abandoned(parent: Path, prefix: str) -> None:
    """Remove the directories of the user's killed processes, which the kernel has unlocked."""
    for path in parent.glob(f"{prefix}*"):
        with (
            suppress(OSError),
            lock_directory(path, LOCK_EX | LOCK_NB) as status,
        ):  # another user's, locked, or already removed
            if status.st_uid == os.getuid() and abs(time.time() - status.st_mtime) > MIN_AGE_S:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def lock_directory(path: Path, flags: int = LOCK_EX) -> Iterator[os.stat_result]:
    """Lock a directory against other processes and threads, as a context manager that yields its state.

    Raises OSError, including when `flags` has LOCK_NB and the directory is locked already.
    """
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        flock(fd, flags)
        yield os.fstat(fd)
    finally:
        os.close(fd)
