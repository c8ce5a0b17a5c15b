"""Reads PlayCanvas' compressed PLY as its engine does (`gsplat-compressed-data.js`), all of it or its first rows."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Gaussians

C0 = 0.28209479177387814
CHUNK = 256
RANGES = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
TYPES = {"float": "<f4", "uint": "<u4", "uchar": "u1"}


def read_compressed_ply(path: Path, first: int | None = None) -> Gaussians:
    """All Gaussians; or the first ones, without their SH coefficients, which follow at the end."""
    content = path.read_bytes()
    end = content.index(b"end_header\n") + len(b"end_header\n")
    elements: dict[str, np.ndarray[tuple[int], np.dtype[np.void]]] = {}
    offset = end
    for text in re.split(r"(?m)^element ", content[:end].decode())[1:]:
        name, count = text.split("\n")[0].split()
        kinds = np.dtype([(each[1], TYPES[each[0]]) for each in re.findall(r"property (\w+) (\w+)", text)])
        elements[name] = np.frombuffer(content, kinds, int(count), offset)
        offset += int(count) * kinds.itemsize
    assert offset == len(content)
    vertices = elements["vertex"][:first]
    chunks = elements["chunk"][np.arange(len(vertices)) // CHUNK]
    positions, scales, colours = (
        np.stack([chunks[f"min_{name}"] for name in names], 1)
        + shares * np.stack([chunks[f"max_{name}"] - chunks[f"min_{name}"] for name in names], 1)
        for names, shares in zip(
            RANGES,
            (
                _unpacked(vertices["packed_position"], (11, 10, 11)),
                _unpacked(vertices["packed_scale"], (11, 10, 11)),
                _unpacked(vertices["packed_color"], (8, 8, 8, 8))[:, :3],
            ),
            strict=True,
        )
    )
    sh = ((colours - 0.5) / C0)[:, None]
    if "sh" in elements and first is None:
        rows = elements["sh"]
        bytes_ = np.stack([rows[name] for name in rows.dtype.names or ()], 1)
        sh = np.concatenate((sh, (bytes_ * (8 / 255) - 4).reshape(len(rows), 3, -1).transpose(0, 2, 1)), axis=1)
    opacities = _unpacked(vertices["packed_color"], (8, 8, 8, 8))[:, 3]
    arrays = (positions, np.exp(scales), _rotations(vertices["packed_rotation"]), opacities, sh)
    return Gaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays))


def _unpacked(words: NDArray[Any], bits: tuple[int, ...]) -> NDArray[np.float64]:
    """Shares, 0 to 1, from the highest bits to the lowest."""
    shifts = [sum(bits[i + 1 :]) for i in range(len(bits))]
    parts = [(words >> shift & ((1 << each) - 1)) / ((1 << each) - 1) for shift, each in zip(shifts, bits, strict=True)]
    return np.stack(parts, axis=1)


def _rotations(words: NDArray[np.uint32]) -> NDArray[np.float64]:
    others = (_unpacked(words & 0x3FFFFFFF, (10, 10, 10)) - 0.5) * np.sqrt(2)
    largest = (words >> 30).astype(int)
    quaternions = np.empty((len(words), 4))
    quaternions[np.arange(4) != largest[:, None]] = others.ravel()
    quaternions[np.arange(len(words)), largest] = np.sqrt(np.maximum(0, 1 - (others**2).sum(1)))
    return quaternions
