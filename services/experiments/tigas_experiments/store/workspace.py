"""A hidden folder for incomplete files, on the same disk as the results.

Complete files are moved to their place atomically; files to be removed are moved into this folder first. Leftovers of a
killed store are removed at the next start.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tigas_common.errors import StartError
from tigas_experiments.lock import hold_lock

NAME = ".store"
LOCK = "lock"


class Workspace:
    """The hidden folder of a results directory."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @classmethod
    @contextmanager
    def open(cls, results: Path) -> Iterator[Workspace]:
        """Open an exclusive, empty workspace during the context. Raises StartError."""
        root = results / NAME
        with ExitStack() as stack:
            try:
                root.mkdir(parents=True, exist_ok=True)
                busy = f"Another store keeps its results in {results}; choose another folder."
                stack.enter_context(hold_lock(root / LOCK, busy))
            except OSError as error:
                raise StartError(f"Results cannot be kept in {results}: {error.strerror or error}.") from None
            for left in root.iterdir():
                if left.name != LOCK:
                    shutil.rmtree(left, ignore_errors=True)
            yield cls(root)

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """A temporary folder, removed at the end of the context. Raises OSError."""
        made = Path(tempfile.mkdtemp(dir=self._root))
        try:
            yield made
        finally:
            shutil.rmtree(made, ignore_errors=True)

    def remove(self, folder: Path) -> None:
        """Remove a folder of the results atomically. Raises OSError."""
        with self.folder() as last:
            folder.rename(last / "removed")
