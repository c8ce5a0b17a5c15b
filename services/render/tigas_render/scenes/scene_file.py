"""A scene's file in any format: its description, and its Gaussians, decoded block by block."""

from __future__ import annotations

import io
import logging
import mmap
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.gaussians import Batches, Gaussians

BLOCK = 4096
"""Number of Gaussians read at a time, so that memory does not grow with the scene."""
FARTHEST = 1e9
"""Maximum coordinate and scale in scene units: no camera goes farther, and squares of larger scales overflow."""
SAMPLE = 1 << 17
"""Approximate number of Gaussians in a large scene's sample, which are read and packed in a quarter of a second."""
MAX_STEP = 256
"""Maximum step of a sample: the number of Gaussians in a chunk of a compressed PLY."""
C0 = 0.28209479177387814
"""The spherical harmonic of degree 0: 1 / (2 √π)."""

_log = logging.getLogger(__name__)

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.void]
Listener = Callable[[float], None]
"""Progress callback of a long task, called with 0 to 1. It may raise an error to abort the task."""


class Columns:
    """A buffer for a block of Gaussians, as float32. Decoders must write every row of every array."""

    def __init__(self, count: int, sh_degree: int) -> None:
        self.means = np.empty((count, 3), np.float32)
        self.scales = np.empty((count, 3), np.float32)
        """Standard deviations."""
        self.quaternions = np.empty((count, 4), np.float32)
        """w, x, y, z."""
        self.opacities = np.empty(count, np.float32)
        """0 to 1; NaN drops a Gaussian."""
        self.sh = np.empty((count, (sh_degree + 1) ** 2, 3), np.float32)

    def __len__(self) -> int:
        return len(self.means)

    def select(self, rows: NDArray[np.bool_], sh_degree: int) -> Columns:
        """The selected rows, extended to an equal or higher SH degree with coefficients of 0."""
        some = Columns(int(np.count_nonzero(rows)), sh_degree)
        some.means[:], some.scales[:] = self.means[rows], self.scales[rows]
        some.quaternions[:], some.opacities[:] = self.quaternions[rows], self.opacities[rows]
        some.sh[:, : self.sh.shape[1]], some.sh[:, self.sh.shape[1] :] = self.sh[rows], 0
        return some

    def gaussians(self, *, antialiased: bool) -> Gaussians:
        """The drawable Gaussians: finite, within FARTHEST, and with a rotation."""
        usable = np.isfinite(self.quaternions).all(1) & np.isfinite(self.opacities)
        usable &= np.isfinite(self.sh).all((1, 2))
        with np.errstate(invalid="ignore"):
            usable &= (np.abs(self.means) <= FARTHEST).all(1)
            usable &= ((self.scales >= 0) & (self.scales <= FARTHEST)).all(1)
        rows: NDArray[np.bool_] | slice = slice(None) if usable.all() else usable
        arrays = (self.means, self.scales, self.quaternions, self.opacities, self.sh)
        return Gaussians(*(array[rows] for array in arrays), antialiased=antialiased)


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A scene's file or files, as described by their headers and checked against their sizes."""

    format: str
    """The format's name, for display."""
    files: tuple[Path, ...]
    """All files of the scene, the main one first."""
    count: int
    """Number of Gaussians, at least 1."""
    sh_degree: int
    """0 to 3."""
    file_bytes: int
    decode: Callable[[Listener], Iterator[Columns]]
    """Reads all Gaussians in order. Raises BrokenScene and OSError. Uses a few megabytes of memory, unless the format's
    module says otherwise."""
    antialiased: bool = False
    """Whether the scene was trained with Mip-Splatting's 2D filter, according to the file."""
    coarse: Callable[[], SceneFile | None] = lambda: None
    """Describes a small part that shows the whole scene; None if there is no such part. Raises BrokenScene and OSError.
    """

    def with_sample(self, decode: Callable[[int, Listener], Iterator[Columns]]) -> SceneFile:
        """A copy with a sample as its coarse part. decode: reads every nth Gaussian, without SH coefficients."""
        step = min(MAX_STEP, 1 << max(0, (self.count // SAMPLE).bit_length() - 1))
        sample = replace(
            self,
            count=self.count // step,
            sh_degree=0,
            decode=lambda listener: _enlarge(decode(step, listener), enlargement(step)),
        )
        return replace(self, coarse=lambda: sample)

    def open(self, listener: Listener) -> Batches:
        """The drawable Gaussians. listener: progress callback. Reading them raises BrokenScene."""
        return Batches(self.count, self._drawable(listener))

    def check(self) -> None:
        """Read all Gaussians without keeping them. Raises BrokenScene."""
        for _ in self.open(lambda _: None).parts:
            pass

    def load(self) -> Gaussians:
        """Read and return all drawable Gaussians. Raises BrokenScene."""
        return self.open(lambda _: None).read_all()

    @property
    def packed_bytes(self) -> int:
        """Approximate memory of the loaded scene in bytes: rasterisers keep coefficients in half precision."""
        return self.count * (40 + 6 * (self.sh_degree + 1) ** 2)

    def _drawable(self, listener: Listener) -> Iterator[Gaussians]:
        path, count, kept = self.files[0], 0, 0
        with translate_os_errors(path):
            for columns in self.decode(listener):
                gaussians = columns.gaussians(antialiased=self.antialiased)
                count, kept = count + len(columns), kept + len(gaussians)
                if len(gaussians):
                    yield gaussians
        if kept == 0:
            raise BrokenScene(f"{path.name} has no Gaussian whose attributes are finite and within 10⁹.")
        if kept < count:
            _log.warning("%s: dropped %d of %d Gaussians that are not finite, or beyond 10⁹", path, count - kept, count)


def enlargement(times: float) -> np.float32:
    """The best factor by which to enlarge Gaussians that are `times` fewer, or cover an area `times` smaller.

    An exponent of 1/2 would compensate for all of the missing area, but gaps are only part of the error.
    """
    return np.float32(times ** (3 / 8))


def _enlarge(blocks: Iterator[Columns], times: np.float32) -> Iterator[Columns]:
    """Enlarge the Gaussians of each block, to close the gaps between them."""
    for columns in blocks:
        columns.scales *= times
        yield columns


@dataclass(frozen=True, slots=True)
class Table:
    """A table of equally long rows in a binary file."""

    offset: int
    """Number of bytes before the first row."""
    count: int
    dtype: np.dtype[np.void]
    step: int = 1
    """Number of the file's rows per row of the table."""

    @property
    def end(self) -> int:
        return self.offset + self.count * self.dtype.itemsize

    def every(self, step: int) -> Table:
        """A table of every nth row."""
        return replace(self, count=self.count // step, step=step)

    def rows(self, file: io.BufferedReader, start: int, stop: int) -> Rows:
        """Read rows. Raises OSError, and BrokenScene if the file has become shorter.

        The file is not memory-mapped, because truncating a mapped file would crash the process (SIGBUS).
        """
        size, fd = self.dtype.itemsize, file.fileno()
        stride = self.step * size
        begin = self.offset + start * stride
        if stride <= mmap.PAGESIZE:  # the system reads every page anyway
            data = os.pread(fd, (stop - start - 1) * stride + size, begin)
        else:
            data = b"".join([os.pread(fd, size, begin + row * stride) for row in range(stop - start)])
            stride = size
        if len(data) < (stop - start - 1) * stride + size:
            raise _changed_error(Path(file.name))
        return np.ndarray((stop - start,), self.dtype, data, strides=(stride,))


def row_blocks(count: int, listener: Listener) -> Iterator[slice]:
    """Slices of up to BLOCK rows. The listener is called after each."""
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        yield slice(start, stop)
        listener(stop / count)


def file_blocks(
    path: Path, file_bytes: int, count: int, listener: Listener
) -> Iterator[tuple[io.BufferedReader, slice]]:
    """Open a file, and yield it with each of its `row_blocks`. Raises OSError, and BrokenScene if its size changes."""
    with open_regular(path) as file:
        for rows in row_blocks(count, listener):
            if os.fstat(file.fileno()).st_size != file_bytes:
                raise _changed_error(path)
            yield file, rows


def _changed_error(path: Path) -> BrokenScene:
    return BrokenScene(f"{path.name} changed while it was being read; load it again.")


def read_start(path: Path, limit: int) -> tuple[bytes, int]:
    """Up to `limit` bytes from the start of a file, and the file's size in bytes. Raises OSError."""
    with open_regular(path) as file:
        return file.read(limit), os.fstat(file.fileno()).st_size


class UnreadScene(BrokenScene):
    """A scene with an existing file that could not be read this time."""


@contextmanager
def translate_os_errors(path: Path) -> Iterator[None]:
    """Turn OSErrors into BrokenScene, or UnreadScene if the file exists."""
    try:
        yield
    except OSError as error:
        kind = BrokenScene if isinstance(error, FileNotFoundError) else UnreadScene
        raise kind(f"{path.name} cannot be read: {error.strerror or error}.") from None


def check_packed_count(name: str, count: int, file_bytes: int) -> None:
    """Raise BrokenScene for implausible compression: a few bytes that announce gigabytes of Gaussians."""
    if count == 0:
        raise BrokenScene(f"{name} has 0 Gaussians, so there is nothing to show.")
    if count > file_bytes:
        raise BrokenScene(f"{name} promises {count} Gaussians in {file_bytes} bytes; each takes at least one.")


def normalise(quaternions: Floats) -> Floats:
    """Normalise quaternions [N, 4] to length one; NaN for a length of zero."""
    wide = quaternions.astype(np.float64)  # because the square of a float32 may overflow
    with np.errstate(all="ignore"):
        wide /= np.linalg.norm(wide, axis=1, keepdims=True)
    return wide


def add_largest(others: Floats, largest: NDArray[np.integer[Any]]) -> Floats:
    """Unit quaternions [N, 4] from three components [N, 3]; the missing one, at index `largest` [N], is positive."""
    quaternions = np.empty((len(others), 4), np.float64)
    quaternions[np.arange(4) != largest[:, None]] = others.reshape(-1)
    missing = np.sqrt(np.maximum(0, 1 - (others.astype(np.float64) ** 2).sum(1)))
    quaternions[np.arange(len(others)), largest] = missing
    return normalise(quaternions)
