"""Temporary directories that are removed even if the process that made them was killed: the next one does it."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path

YOUNG_S = 10.0
"""Seconds after its creation for which a directory may not be locked yet."""


@contextmanager
def locked_directory(parent: Path, prefix: str) -> Iterator[Path]:
    """A new directory private to this user, locked by a context manager.

    Abandoned directories with the same prefix, which belongs to one program alone, are removed first. Raises OSError.
    """
    _remove_abandoned(parent, prefix)
    with (
        tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True) as name,  # mode 0700
        _locked(Path(name), LOCK_EX),
    ):
        yield Path(name)


def _remove_abandoned(parent: Path, prefix: str) -> None:
    """Remove the directories of this user's killed processes: the kernel releases a lock with its process."""
    for path in parent.glob(f"{prefix}*"):
        with (
            suppress(OSError),
            _locked(path, LOCK_EX | LOCK_NB) as status,
        ):  # another user's, locked, or already removed
            if status.st_uid == os.getuid() and abs(time.time() - status.st_mtime) > YOUNG_S:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _locked(path: Path, how: int) -> Iterator[os.stat_result]:
    """A directory's state, while it is locked. Raises OSError if `how` is not to wait and it is locked already."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        flock(fd, how)
        yield os.fstat(fd)
    finally:
        os.close(fd)
