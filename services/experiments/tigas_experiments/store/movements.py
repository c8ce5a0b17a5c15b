"""Movement traces in a directory, for pages to play."""

from __future__ import annotations

import logging
from functools import lru_cache
from pathlib import Path

from tigas_common.files import read_regular
from tigas_experiments.movement.table import MAX_BYTES, MovementError
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.store.errors import UnknownMovement, storage_errors
from tigas_experiments.wire.store import Movement, MovementList

logger = logging.getLogger(__name__)


class Movements:
    """The files NAME.csv of a directory, which is read anew each time; files that are not movements are ignored."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def all(self) -> MovementList:
        found = []
        for path in sorted(self._directory.glob("*.csv")):
            try:
                path.name.encode()
                found.append(_describe(path))
            except UnicodeEncodeError:
                logger.warning("%r is left out, because its name is not UTF-8.", path.name)
            except UnknownMovement as error:
                logger.warning("%s", error.detail)
        return MovementList(movements=tuple(found))

    def text(self, name: str) -> bytes:
        """Content of a movement's file. Raises UnknownMovement."""
        path = self._directory / f"{name}.csv"
        # Compared with the existing names, as a path could lead anywhere.
        if path not in self._directory.glob("*.csv"):
            raise UnknownMovement(f"There is no movement {name[:100]!r}.")
        _describe(path)
        with storage_errors():
            return read_regular(path, MAX_BYTES)


def _describe(path: Path) -> Movement:
    try:
        told = path.stat()
    except OSError as error:
        raise UnknownMovement(f"The movement {path} cannot be read: {error.strerror or error}.") from None
    return _read(path, told.st_mtime_ns, told.st_size)


@lru_cache(1000)
def _read(path: Path, _modified_ns: int, _size: int) -> Movement:
    try:
        trace = MovementTrace.read(path)
    except MovementError as error:
        raise UnknownMovement(str(error)) from None
    return Movement(
        name=path.stem, duration_ms=trace.duration_ms, anchor=trace.anchor, description=trace.description[:1000]
    )
