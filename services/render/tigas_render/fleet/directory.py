"""The directory of the engine's own sockets.

It is removed at the service's end, by the children if the supervisor was killed, and if they were killed with it, when
the next service starts.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path

PREFIX = "tigas-render-"
YOUNG_S = 10.0
"""For so long after it was made, a directory may be one that is not locked yet, in seconds."""


@contextmanager
def private_directory() -> Iterator[Path]:
    """A directory that only the service's own user may enter, locked for as long as the context lasts."""
    _remove_abandoned()
    with (
        tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as name,  # made with mode 0700
        _locked(Path(name), LOCK_EX),
    ):
        yield Path(name)


def _remove_abandoned() -> None:
    """Remove what services of this user have left that were killed: the kernel releases a lock with its process."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError), _locked(path, LOCK_EX | LOCK_NB) as status:  # somebody else's, locked, or gone
            if status.st_uid == os.getuid() and status.st_mtime < time.time() - YOUNG_S:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _locked(path: Path, how: int) -> Iterator[os.stat_result]:
    """A directory's state, while it is locked. Raises OSError if somebody has the lock and `how` is not to wait."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        flock(fd, how)
        yield os.fstat(fd)
    finally:
        os.close(fd)
