"""Contents announced by a scene's file in any format, validated against its size before any allocation."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.columns import Columns, Listener, drawable


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene's file, or files, as their headers describe them."""

    format: str
    """For people."""
    files: tuple[Path, ...]
    """All of its files, the main one first."""
    count: int
    """Number of Gaussians, at least 1."""
    sh_degree: int
    """0 to 3."""
    file_bytes: int
    decode: Callable[[Listener], Iterator[Columns]]
    """Reads them from first to last. Raises BrokenScene. It takes a few megabytes, unless its module says otherwise."""
    antialiased: bool = False
    """Whether it was trained with Mip-Splatting's 2D filter, if the file says so."""

    def open(self, listener: Listener) -> Batches:
        """Its Gaussians, to be read with a progress callback. Reading raises BrokenScene."""
        return Batches(self.count, drawable(self.files[0], self.decode(listener), antialiased=self.antialiased))

    def check(self) -> None:
        """Read everything, and keep nothing. Raises BrokenScene."""
        for _ in self.open(lambda _: None).parts:
            pass

    def load(self) -> Gaussians:
        """All of its Gaussians. Raises BrokenScene."""
        return self.open(lambda _: None).gathered()

    @property
    def packed_bytes(self) -> int:
        """Bytes that it takes when it is loaded, about: rasterisers keep coefficients in half precision."""
        return self.count * (40 + 6 * (self.sh_degree + 1) ** 2)


def read_start(path: Path, limit: int) -> tuple[bytes, int]:
    """A file's first bytes, at most `limit`, and how many it has. Raises BrokenScene."""
    try:
        with open_regular(path) as file:
            file_bytes = file.seek(0, io.SEEK_END)
            file.seek(0)
            return file.read(limit), file_bytes
    except OSError as error:
        raise unreadable(path, error) from None


def unreadable(path: Path, error: OSError) -> BrokenScene:
    """Broken scene for a file that the system cannot read."""
    return BrokenScene(f"{path.name} cannot be read: {error.strerror or error}.")


def check_packed_count(name: str, count: int, file_bytes: int) -> None:
    """Refuse implausible compression: a few bytes that announce gigabytes of Gaussians. Raises BrokenScene."""
    if count == 0:
        raise BrokenScene(f"{name} has 0 Gaussians, so there is nothing to show.")
    if count > file_bytes:
        raise BrokenScene(f"{name} promises {count} Gaussians in {file_bytes} bytes; each takes at least one.")
