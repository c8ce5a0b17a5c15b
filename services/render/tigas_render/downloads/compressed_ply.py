"""Writes PlayCanvas' compressed PLY: 16 bytes a Gaussian, and a byte for each coefficient of its spherical harmonics.

The format, as https://github.com/playcanvas/splat-transform writes it and PlayCanvas reads it: chunks of 256 Gaussians
have the ranges of their positions, scales (logarithms) and colours as float32; then come all Gaussians, as four uint32
each, packed within these ranges; then all coefficients, channel-major. `scenes.compressed_ply` reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tigas_render.gaussians import Gaussians
from tigas_render.scenes.columns import C0, Floats
from tigas_render.scenes.compressed_ply import CHUNK, PACKED, RANGES, SH_RANGE
from tigas_render.scenes.ply import ply_header, rest_names

BLOCK = 64 * CHUNK
"""Gaussians that are packed at a time."""
LOG_SCALE_LIMIT = 20.0


def write_compressed_ply(
    path: Path, gaussians: Gaussians, order: NDArray[np.int64], comments: Iterable[str] = ()
) -> None:
    """Write the Gaussians with these indices [M] in this order; those of a chunk should be neighbours.

    comments: for the header.

    Memory beyond the arrays themselves is a few megabytes and 16 bytes per Gaussian. Raises OSError.
    """
    rest = rest_names(gaussians.sh_degree)
    elements = [
        ("chunk", math.ceil(len(order) / CHUNK), "float", RANGES),
        ("vertex", len(order), "uint", PACKED),
        *([("sh", len(order), "uchar", rest)] if rest else []),
    ]
    blocks = [order[start : start + BLOCK] for start in range(0, len(order), BLOCK)]
    packed: list[NDArray[np.uint32]] = []
    with path.open("wb") as file:
        file.write(ply_header(elements, comments))
        for ranges, words in (_pack(gaussians, block) for block in blocks):
            file.write(ranges.astype("<f4").tobytes())
            packed.append(words)
        for words in packed:
            file.write(words.astype("<u4").tobytes())
        for block in blocks if rest else ():
            file.write(_coefficients(gaussians, block).tobytes())


def _pack(gaussians: Gaussians, block: NDArray[np.int64]) -> tuple[Floats, NDArray[np.uint32]]:
    """A block's ranges [chunks, 18] and words [len(block), 4]."""
    scales = gaussians.scales[block].clip(np.finfo(np.float32).tiny)
    positions, position_ranges = _in_chunk(gaussians.means[block])
    sizes, size_ranges = _in_chunk(np.log(scales).clip(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT))
    hues, hue_ranges = _in_chunk(gaussians.sh[:, 0][block] * C0 + 0.5)
    opacities = gaussians.opacities[block, None]
    largest, others = _rotations(gaussians.quaternions[block])
    words = (
        _packed(positions, (11, 10, 11)),
        _packed(others, (10, 10, 10)) | largest << 30,
        _packed(sizes, (11, 10, 11)),
        _packed(np.concatenate((hues, opacities), axis=1), (8, 8, 8, 8)),
    )
    return np.concatenate((position_ranges, size_ranges, hue_ranges), axis=1), np.stack(words, axis=1)


def _in_chunk(values: Floats) -> tuple[Floats, Floats]:
    """Values [N, 3] as shares, 0 to 1, of their chunks' ranges, and these [chunks, 6]: all lows, then all highs."""
    starts = np.arange(0, len(values), CHUNK)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    chunk = np.arange(len(values)) // CHUNK
    extent = np.maximum(high.astype(np.float64) - low, np.finfo(np.float32).tiny)
    return (values - low[chunk]) / extent[chunk], np.concatenate((low, high), axis=1)


def _rotations(quaternions: Floats) -> tuple[NDArray[np.uint32], Floats]:
    """Of unit quaternions w, x, y, z [N, 4] which part is the largest [N], and the others, from 0 to 1 [N, 3]."""
    largest = np.abs(quaternions).argmax(1)[:, None]
    positive = quaternions * np.where(np.take_along_axis(quaternions, largest, 1) < 0, -1, 1)
    others = positive[np.arange(4) != largest].reshape(-1, 3)
    return largest[:, 0].astype(np.uint32), others / math.sqrt(2) + 0.5


def _coefficients(gaussians: Gaussians, block: NDArray[np.int64]) -> NDArray[np.uint8]:
    """All but the first, [len(block), 3, K − 1]."""
    rest = gaussians.sh[block, 1:].transpose(0, 2, 1)
    # 0 is halfway between two steps: the rounding direction alternates, so that it does not become a colour cast
    side = 1e-4 * np.where(np.indices(rest.shape).sum(0) % 2, 1, -1)
    return _whole(rest / SH_RANGE + 0.5 + side, 8).astype(np.uint8)


def _packed(shares: Floats, bits: Sequence[int]) -> NDArray[np.uint32]:
    """Pack fractions [N, k], 0 to 1, with the given bits each, the first in the highest bits: [N]."""
    word = np.zeros(len(shares), np.uint32)
    for column, each in zip(shares.T, bits, strict=True):
        word <<= np.uint32(each)
        word |= _whole(column, each)
    return word


def _whole(shares: Floats, bits: int) -> NDArray[np.uint32]:
    whole: NDArray[np.uint32] = np.rint(shares.clip(0, 1) * ((1 << bits) - 1)).astype(np.uint32)
    return whole
