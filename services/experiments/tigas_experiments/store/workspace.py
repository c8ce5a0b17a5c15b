"""Where things are while they are not whole: a hidden folder on the results' own disk.

What is complete there is renamed to its place, which is one step for whoever looks; what is to be removed is renamed
away first. Whatever a killed store leaves behind lies here and goes at the next start.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tigas_common.errors import StartError
from tigas_experiments.lock import exclusive

NAME = ".store"
LOCK = "lock"


class Workspace:
    """The hidden folder of a results directory."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @classmethod
    @contextmanager
    def opened(cls, results: Path) -> Iterator[Workspace]:
        """This process' own for as long as the context lasts, cleared. Raises StartError."""
        root = results / NAME
        with ExitStack() as stack:
            try:
                root.mkdir(parents=True, exist_ok=True)
                busy = f"Another store keeps its results in {results}; choose another folder."
                stack.enter_context(exclusive(root / LOCK, busy))
            except OSError as error:
                raise StartError(f"Results cannot be kept in {results}: {error.strerror or error}.") from None
            for left in root.iterdir():
                if left.name != LOCK:
                    shutil.rmtree(left, ignore_errors=True)
            yield cls(root)

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """An empty folder; what is still in it at the end is removed. Raises OSError."""
        made = Path(tempfile.mkdtemp(dir=self._root))
        try:
            yield made
        finally:
            shutil.rmtree(made, ignore_errors=True)

    def remove(self, folder: Path) -> None:
        """Remove a folder of the results: it is gone from there in one step. Raises OSError."""
        with self.folder() as last:
            folder.rename(last / "removed")


def to_disk(folder: Path) -> None:
    """Have all that is in a folder on the disk, so that not even a power failure leaves half of it. Raises OSError."""
    for parent, _, names in os.walk(folder):
        for path in (*(Path(parent, name) for name in names), Path(parent)):
            handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
