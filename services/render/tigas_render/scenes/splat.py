"""Reads `.splat` files: 32 bytes per Gaussian, without a header and without spherical harmonics.

The format (https://github.com/antimatter15/splat): position and standard deviations as float32, then colour and opacity
as four bytes, then a quaternion w, x, y, z as four bytes, where 128 stands for 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tigas_render.scenes.scene_file import (
    C0,
    FARTHEST,
    Columns,
    Floats,
    Listener,
    Rows,
    SceneFile,
    Table,
    file_blocks,
    normalise,
    read_start,
)

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])
SAMPLE = 1024
"""Number of records examined to identify the format."""


def looks_like_splat(start: bytes, file_bytes: int) -> bool:
    """Whether a file with this start is a `.splat` file: nine of ten records must be plausible."""
    if file_bytes == 0 or file_bytes % RECORD.itemsize:
        return False
    records = np.frombuffer(start, RECORD, min(len(start) // RECORD.itemsize, SAMPLE))
    with np.errstate(all="ignore"):
        sound = (np.abs(records["position"]) <= FARTHEST).all(1)
        sound &= ((records["scale"] >= 0) & (records["scale"] <= FARTHEST)).all(1)
        sound &= np.abs(np.linalg.norm(_quaternions(records), axis=1) - 1) < 0.05
    return len(records) > 0 and float(sound.mean()) >= 0.9


def read_splat(path: Path) -> SceneFile:
    """Describe a file. Raises OSError."""
    _, file_bytes = read_start(path, 0)
    table = Table(0, file_bytes // RECORD.itemsize, RECORD)
    file = SceneFile(".splat", (path,), table.count, 0, file_bytes, partial(_decode, path, file_bytes, table))
    return file.with_sample(lambda step, listener: _decode(path, file_bytes, table.every(step), listener))


def _decode(path: Path, file_bytes: int, table: Table, listener: Listener) -> Iterator[Columns]:
    for file, block in file_blocks(path, file_bytes, table.count, listener):
        records = table.rows(file, block.start, block.stop)
        columns = Columns(len(records), 0)
        columns.means[:] = records["position"]
        columns.scales[:] = records["scale"]
        columns.quaternions[:] = normalise(_quaternions(records))
        columns.opacities[:] = records["colour"][:, 3] / np.float32(255)
        columns.sh[:, 0] = (records["colour"][:, :3] / np.float32(255) - 0.5) / C0
        yield columns


def _quaternions(records: Rows) -> Floats:
    return (records["rotation"].astype(np.float32) - 128) / 128
