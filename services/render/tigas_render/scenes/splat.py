"""Reads `.splat` files: 32 bytes a Gaussian, with no header and no spherical harmonics.

The format (https://github.com/antimatter15/splat): position and standard deviations as float32, then colour and opacity
as four bytes, then a quaternion w, x, y, z as four bytes, 128 for 0.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import BrokenScene
from tigas_common.files import open_regular
from tigas_render.scenes.columns import C0, FARTHEST, Columns, Floats, Listener, blocks, normalised
from tigas_render.scenes.scene_file import SceneFile, read_start, unreadable

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])
SAMPLE = 1024
"""Number of records examined to identify the format."""

_Records = NDArray[np.void]


def looks_like_splat(start: bytes, file_bytes: int) -> bool:
    """Whether a file with this start consists of such records: nine of ten must be plausible."""
    if file_bytes == 0 or file_bytes % RECORD.itemsize:
        return False
    records = np.frombuffer(start, RECORD, min(len(start) // RECORD.itemsize, SAMPLE))
    with np.errstate(all="ignore"):
        sound = (np.abs(records["position"]) <= FARTHEST).all(1)
        sound &= ((records["scale"] >= 0) & (records["scale"] <= FARTHEST)).all(1)
        sound &= np.abs(np.linalg.norm(_quaternions(records), axis=1) - 1) < 0.05
    return len(records) > 0 and float(sound.mean()) >= 0.9


def read_splat(path: Path) -> SceneFile:
    """Raises BrokenScene, with one sentence, if its size is not that of records."""
    _, file_bytes = read_start(path, 0)
    if file_bytes == 0 or file_bytes % RECORD.itemsize:
        raise BrokenScene(f"{path.name} is no .splat: {file_bytes} bytes are not a multiple of {RECORD.itemsize}.")
    count = file_bytes // RECORD.itemsize
    return SceneFile(".splat", (path,), count, 0, file_bytes, partial(_decode, path, count))


def _decode(path: Path, count: int, listener: Listener) -> Iterator[Columns]:
    try:
        with open_regular(path) as file:
            for rows in blocks(count, listener):
                if os.fstat(file.fileno()).st_size != count * RECORD.itemsize:
                    raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
                records = np.memmap(file, RECORD, "r", rows.start * RECORD.itemsize, (rows.stop - rows.start,))
                columns = Columns(len(records), 0)
                columns.means[:] = records["position"]
                columns.scales[:] = records["scale"]
                columns.quaternions[:] = normalised(_quaternions(records))
                columns.opacities[:] = records["colour"][:, 3] / np.float32(255)
                columns.sh[:, 0] = (records["colour"][:, :3] / np.float32(255) - 0.5) / C0
                yield columns
    except OSError as error:
        raise unreadable(path, error) from None


def _quaternions(records: _Records) -> Floats:
    return (records["rotation"].astype(np.float32) - 128) / 128
