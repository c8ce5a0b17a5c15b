"""Reads PlayCanvas' SOG scenes: lossless WebP images and a meta.json, about a twentieth of the size of a PLY.

The format, version 2: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/. Each Gaussian is
the same pixel in several images, row by row. The images are decoded one after the other, which takes about 24 bytes per
Gaussian, and the result, 17 to 19 bytes per Gaussian, is kept while the Gaussians are decoded.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image, WebPImagePlugin
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.parsing import parse
from tigas_common.wire.model import Entries
from tigas_render.scenes.scene_file import (
    Columns,
    Listener,
    SceneFile,
    add_largest,
    check_packed_count,
    row_blocks,
    translate_os_errors,
)
from tigas_render.scenes.sog_files import META, Read, open_files

MAX_META = 256 * 1024
"""Maximum size of a meta.json in bytes; three codebooks take about 15,000."""
MAX_COUNT = 1 << 27
"""Maximum number of Gaussians; more do not fit in a WebP image that Pillow opens."""
PALETTE_WIDTH = 64
"""Number of palette entries per row of its image."""

PLAIN_NAME = re.compile(r"[\w-][\w .-]{0,99}", re.ASCII)
SPARE_PIXELS = 1 << 16
"""Pixels allowed beyond two per Gaussian, because rows are whole and small scenes may have large images."""
MAX_IMAGE_BYTES = 1 << 30
STRIP_ROWS = 64
"""Number of rows copied from a decoded image at a time."""
LOSSLESS, EXTENDED = b"VP8L", b"VP8X"
FIRST_TAG = 252
"""The fourth byte of a rotation, minus this, is the index of the largest component."""

IMAGES_SHARE = 0.5
"""Approximate share of the reading time spent on decoding the images."""

_Pixels = NDArray[np.uint8]
_Decoder = Callable[[Columns, slice], None]
"""Writes one attribute of a slice of the Gaussians to a buffer."""

Triple = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Codebook = Annotated[Entries[FiniteFloat], Field(min_length=256, max_length=256)]
Name = Annotated[str, Field(max_length=100)]


class _Part(BaseModel):
    """A part of a meta.json; unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class Means(_Part):
    """Positions, as sign(x) · ln(1 + |x|) in 16 bits."""

    mins: Triple
    maxs: Triple
    files: tuple[Name, Name]
    """Images with the lower and the upper bytes."""


class Quaternions(_Part):
    files: tuple[Name]


class Coded(_Part):
    """Scales (logarithms), or first coefficients with opacities, as bytes that index a codebook."""

    codebook: Codebook
    files: tuple[Name]


class Palette(_Part):
    """The other coefficients, as a palette of which each Gaussian has one entry."""

    count: int = Field(ge=1, le=1 << 16)
    bands: int = Field(ge=1, le=3)
    codebook: Codebook
    files: tuple[Name, Name]
    """Images with the entries, and with the index of each Gaussian's entry."""

    @property
    def coefficients(self) -> int:
        """Number of coefficients per colour in an entry."""
        return (self.bands + 1) ** 2 - 1


class SogMeta(_Part):
    """The content of a meta.json."""

    version: Literal[2]
    count: int = Field(ge=1, le=MAX_COUNT)
    antialias: bool = False
    model: object = None
    means: Means
    scales: Coded
    quats: Quaternions
    sh0: Coded
    shN: Palette | None = None

    @property
    def sh_degree(self) -> int:
        return self.shN.bands if self.shN else 0

    @property
    def antialiased(self) -> bool:
        """Whether the scene was trained antialiased, which splat-transform writes as `model` since version 3."""
        return self.antialias or self.model == "antialiased"

    @property
    def names(self) -> tuple[str, ...]:
        palette = self.shN.files if self.shN else ()
        return (*self.means.files, *self.scales.files, *self.quats.files, *self.sh0.files, *palette)

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for name in self.names:
            if not PLAIN_NAME.fullmatch(name):
                raise ValueError(f"{name[:40]!r} is not a plain name of a file next to it")
        return self


def read_sog(path: Path, *, bundled: bool) -> SceneFile:
    """Describe the scene with this meta.json, or zip. Raises OSError, and BrokenScene, with one sentence."""
    with open_files(path, bundled=bundled) as read:
        meta = _parse_meta(path.name, read(META, MAX_META))
    files = (path,) if bundled else (path, *(path.with_name(name) for name in dict.fromkeys(meta.names)))
    file_bytes = 0
    for file in files:
        with translate_os_errors(file):
            file_bytes += file.stat().st_size
    check_packed_count(path.name, meta.count, file_bytes)
    format = "SOG" if bundled else "SOG folder"
    decode = partial(_decode, path, bundled, meta.count, meta.sh_degree, file_bytes)
    return SceneFile(format, files, meta.count, meta.sh_degree, file_bytes, decode, meta.antialiased)


def _parse_meta(name: str, content: bytes) -> SogMeta:
    """Parse a meta.json. name: the scene file's name, for error messages. Raises BrokenScene."""
    try:
        return parse(SogMeta, content, MAX_META)
    except InvalidRequest as error:
        raise BrokenScene(f"{name} has a meta.json that is not one of SOG, version 2: {error.detail}") from None


def _decode(
    path: Path, bundled: bool, count: int, sh_degree: int, file_bytes: int, listener: Listener
) -> Iterator[Columns]:
    with open_files(path, bundled=bundled) as read:
        meta = _parse_meta(path.name, read(META, MAX_META))
        if (meta.count, meta.sh_degree) != (count, sh_degree):
            raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
        images = _Images(read, count, min(file_bytes, MAX_IMAGE_BYTES))
        parts: list[Callable[[], _Decoder]]
        parts = [partial(part, meta, images) for part in (_means, _scales, _quaternions, _colours)]
        if meta.shN:
            parts.append(partial(_coefficients, meta.shN, images))
        decoders = []
        for done, part in enumerate(parts, 1):
            decoders.append(part())
            listener(IMAGES_SHARE * done / len(parts))
    for rows in row_blocks(meta.count, lambda share: listener(IMAGES_SHARE + (1 - IMAGES_SHARE) * share)):
        columns = Columns(rows.stop - rows.start, meta.sh_degree)
        for decode in decoders:
            decode(columns, rows)
        yield columns


class _Images:
    """Reads and decodes the images of a scene."""

    def __init__(self, read: Read, count: int, limit: int) -> None:
        self._read = read
        self._count = count
        self._limit = limit

    def gaussian_pixels(self, name: str, channels: int) -> _Pixels:
        """The Gaussians' pixels in an image, [count, channels]."""
        # allocated before decoding, so that the decoder's memory is at the end of the heap and can be returned
        pixels = np.empty((self._count, channels), np.uint8)
        most = 2 * self._count + SPARE_PIXELS
        with self._decode(name, lambda width, height: self._count <= width * height <= most) as image:
            width, height = image.size
            for top in range(0, height, STRIP_ROWS):
                strip = image.crop((0, top, width, min(top + STRIP_ROWS, height)))
                rows = np.asarray(strip if channels <= 3 else strip.convert("RGBA")).reshape(
                    strip.width * strip.height, -1
                )
                into = pixels[top * width : top * width + len(rows)]
                into[:] = rows[: len(into), :channels]
        return pixels

    def palette_pixels(self, name: str, palette: Palette) -> _Pixels:
        """The palette in an image, [palette.count, palette.coefficients, 3]."""
        size = (PALETTE_WIDTH * palette.coefficients, math.ceil(palette.count / PALETTE_WIDTH))
        with self._decode(name, lambda width, height: width == size[0] and size[1] <= height <= 1024) as image:
            return np.asarray(image)[..., :3].reshape(-1, palette.coefficients, 3)[: palette.count]

    @contextmanager
    def _decode(self, name: str, fits: Callable[[int, int], bool]) -> Iterator[Image.Image]:
        content = self._read(name, self._limit)
        size = _webp_size(content)
        if size is None:
            raise BrokenScene(f"{name} is not a lossless WebP image.")
        if not fits(*size):
            raise BrokenScene(f"{name} has {size[0]} × {size[1]} pixels, which does not fit the scene's meta.json.")
        try:
            with WebPImagePlugin.WebPImageFile(io.BytesIO(content)) as image:
                if image.size != size:
                    raise BrokenScene(f"{name} has two different sizes in its headers.")
                image.load()
                yield image
        except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
            raise BrokenScene(f"{name} cannot be decoded: {str(error).rstrip('.')}.") from None


def _webp_size(content: bytes) -> tuple[int, int] | None:
    """Width and height from the header, before anything is allocated; None if it is not WebP, or certainly lossy."""
    if len(content) < 30 or content[:4] != b"RIFF" or content[8:12] != b"WEBP":
        return None
    if content[12:16] == LOSSLESS:
        bits = int.from_bytes(content[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if content[12:16] == EXTENDED:
        return int.from_bytes(content[24:27], "little") + 1, int.from_bytes(content[27:30], "little") + 1
    return None


def _means(meta: SogMeta, images: _Images) -> _Decoder:
    lower, upper = (images.gaussian_pixels(name, 3) for name in meta.means.files)
    start, end = np.array(meta.means.mins), np.array(meta.means.maxs)

    def decode(columns: Columns, rows: slice) -> None:
        shares = (lower[rows] + np.float32(256) * upper[rows]) / 65535.0
        logarithms = start + (end - start) * shares
        with np.errstate(over="ignore"):  # overflowing values are dropped later
            columns.means[:] = np.sign(logarithms) * np.expm1(np.abs(logarithms))

    return decode


def _scales(meta: SogMeta, images: _Images) -> _Decoder:
    with np.errstate(over="ignore"):
        scales = np.exp(np.array(meta.scales.codebook, np.float32))
    pixels = images.gaussian_pixels(meta.scales.files[0], 3)

    def decode(columns: Columns, rows: slice) -> None:
        columns.scales[:] = scales[pixels[rows]]

    return decode


def _quaternions(meta: SogMeta, images: _Images) -> _Decoder:
    pixels = images.gaussian_pixels(meta.quats.files[0], 4)

    def decode(columns: Columns, rows: slice) -> None:
        tags = pixels[rows, 3]
        others = (pixels[rows, :3] / 255 * 2 - 1) / math.sqrt(2)
        quaternions = add_largest(others, np.maximum(tags, FIRST_TAG) - FIRST_TAG)
        columns.quaternions[:] = np.where(tags[:, None] >= FIRST_TAG, quaternions, (1, 0, 0, 0))

    return decode


def _colours(meta: SogMeta, images: _Images) -> _Decoder:
    colours = np.array(meta.sh0.codebook, np.float32)
    pixels = images.gaussian_pixels(meta.sh0.files[0], 4)

    def decode(columns: Columns, rows: slice) -> None:
        columns.sh[:, 0] = colours[pixels[rows, :3]]
        columns.opacities[:] = pixels[rows, 3] / np.float32(255)

    return decode


def _coefficients(palette: Palette, images: _Images) -> _Decoder:
    centroids, labels = palette.files
    entries = np.array(palette.codebook, np.float32)[images.palette_pixels(centroids, palette)]
    pixels = images.gaussian_pixels(labels, 2)

    def decode(columns: Columns, rows: slice) -> None:
        chosen = pixels[rows, 0] + 256 * pixels[rows, 1].astype(np.int64)
        if (chosen >= palette.count).any():
            raise BrokenScene(f"{labels} chooses entry {chosen.max()} of a palette of {palette.count}.")
        columns.sh[:, 1:] = entries[chosen]

    return decode
