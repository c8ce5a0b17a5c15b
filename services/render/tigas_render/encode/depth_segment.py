"""The depth of a frame, stored in its image where all image decoders skip it.

    in a JPEG, the first segment: APP9, its length, `tigas:depth` and a zero byte; `nearest`, float32; an 8-bit image
    in a WebP, the last chunk: `TDEP`, its length; `nearest`, float32; an 8-bit image

Numbers are big-endian, except for the length of a chunk. Code v of a pixel is an inverse depth of nearest · v / 255; 0
is infinitely far.

The 8-bit image is a lossy WebP, or a grayscale JPEG if a device encodes it (raster/cuda/kernels/depth.cu). For a view
of the courtyard, at an error of 2.5 codes in 255 (less than a tenth of a pixel on the screen, after a step of 5 cm), a
WebP took 0.52 kB and 0.5 ms, and a grayscale JPEG 1.0 kB and 0.03 ms. A frame of the lowest rung has 7 kB and costs
10 ms on the same cores, so bytes matter more. More effort (`method`) saves a tenth of the bytes for twice the time. A
frame warped with the decoded depth loses 0.1 dB.
"""

from __future__ import annotations

import io
import math
import struct
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from PIL import Image

IDENTIFIER: Final = b"tigas:depth\0"
QUALITY: Final = 40
METHOD: Final = 2
CLIPPED: Final = 0.005
"""Share of the map that may be nearer than code 255, so that a speck in front of the lens does not use up all codes."""

_SOI, _APP9 = b"\xff\xd8", b"\xff\xe9"
_CHUNK = struct.Struct("<4sI")
"""The header of a RIFF chunk or of a whole WebP. Content of odd length is padded with a byte that does not count."""


class CodedDepth(NamedTuple):
    """The encoded depth of a frame."""

    nearest: float
    """The inverse depth of code 255, in 1/scene units."""
    image: bytes
    """A WebP or JPEG of 8-bit codes, where code v is an inverse depth of nearest · v / 255."""


def encode_depth(inverse: NDArray[np.float32]) -> CodedDepth:
    """Encode an inverse depth [h, w], in 1/scene units."""
    nearest, codes = quantised(np.ascontiguousarray(inverse))
    image = io.BytesIO()
    Image.fromarray(codes).save(image, "WEBP", quality=QUALITY, method=METHOD)
    return CodedDepth(nearest, image.getvalue())


def insert_depth(picture: bytes, depth: CodedDepth) -> bytes:
    """Insert a depth into a JPEG or WebP."""
    content = struct.pack(">f", depth.nearest) + depth.image
    if picture.startswith(b"RIFF"):
        chunks = picture[_CHUNK.size :] + _CHUNK.pack(b"TDEP", len(content)) + content + b"\0" * (len(content) % 2)
        return _CHUNK.pack(b"RIFF", len(chunks)) + chunks
    content = IDENTIFIER + content
    return _SOI + _APP9 + struct.pack(">H", len(content) + 2) + content + picture.removeprefix(_SOI)


@njit("Tuple((float64, uint8[:, ::1]))(float32[:, ::1])", nogil=True, cache=True)
def quantised(inverse: Any) -> Any:
    """The inverse depth of code 255, and the codes [h, w]."""
    codes = np.zeros(inverse.shape, np.uint8)
    values = inverse.ravel()
    rank = math.ceil((1 - CLIPPED) * (len(values) - 1))
    nearest = np.partition(values, rank)[rank]
    if nearest == 0:
        nearest = values.max()
    if nearest > 0:
        scale = 255 / nearest
        for row in range(codes.shape[0]):
            for column in range(codes.shape[1]):
                codes[row, column] = np.uint8(min(inverse[row, column] * scale + 0.5, 255.0))
    return nearest, codes
