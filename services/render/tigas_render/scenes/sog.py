"""Reads SOG scenes of PlayCanvas: about a twentieth of a PLY's bytes, as lossless WebP images and a meta.json.

The format, version 2: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/. Each Gaussian is
the same pixel of several images, row by row. An image is decoded at a time, with some 16 bytes a pixel.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, WebPImagePlugin

from tigas_common.errors import BrokenScene
from tigas_render.gaussians import Gaussians
from tigas_render.scenes.columns import Columns, with_largest
from tigas_render.scenes.scene_file import SceneFile, check_packed_count
from tigas_render.scenes.sog_files import META, Bundle, Folder, SogFiles
from tigas_render.scenes.sog_meta import MAX_META, PALETTE_WIDTH, Palette, SogMeta, parse_meta

SPARE_PIXELS = 1 << 16
"""Beyond as many again as there are Gaussians: images have whole rows, and small scenes may have large ones."""
MOST_IMAGE_BYTES = 1 << 30
LOSSLESS, EXTENDED = b"VP8L", b"VP8X"
FIRST_TAG = 252
"""The fourth byte of a rotation, less this, says which part is the largest."""

_Pixels = NDArray[np.uint8]


def read_sog(path: Path, *, bundled: bool) -> SceneFile:
    """What the scene holds whose meta.json, or zip, this is. Raises BrokenScene, with one sentence."""
    try:
        with _opened(path, bundled) as files:
            meta = parse_meta(path.name, files.read(META, MAX_META))
            paths = files.paths(meta.names)
            file_bytes = sum(each.stat().st_size for each in paths)
    except OSError as error:
        raise BrokenScene(f"{path.name}, or an image of it, cannot be read: {error.strerror or error}.") from None
    check_packed_count(path.name, meta.count, file_bytes)
    return SceneFile(
        "SOG" if bundled else "SOG folder",
        paths,
        meta.count,
        meta.sh_degree,
        file_bytes,
        partial(_load, path, bundled),
        meta.antialias,
    )


def _opened(path: Path, bundled: bool) -> SogFiles:
    return Bundle(path) if bundled else Folder(path)


def _load(path: Path, bundled: bool) -> Gaussians:
    file = read_sog(path, bundled=bundled)
    with _opened(path, bundled) as files:
        meta = parse_meta(path.name, files.read(META, MAX_META))
        if (meta.count, meta.sh_degree) != (file.count, file.sh_degree):
            raise BrokenScene(f"{path.name} changed while it was being read; load it again.")
        columns = Columns(meta.count, meta.sh_degree)
        reader = _Images(files, meta.count, min(file.file_bytes, MOST_IMAGE_BYTES))
        _means(columns, meta, reader)
        _scales(columns, meta, reader)
        _quaternions(columns, meta, reader)
        _colours(columns, meta, reader)
        if meta.shN:
            _coefficients(columns, meta.shN, reader)
    return columns.gaussians(path, antialiased=meta.antialias)


class _Images:
    """The images of a scene, decoded."""

    def __init__(self, files: SogFiles, count: int, limit: int) -> None:
        self._files = files
        self._count = count
        self._limit = limit

    def of_gaussians(self, name: str, channels: int) -> _Pixels:
        """[count, channels]."""
        most = 2 * self._count + SPARE_PIXELS
        pixels = self._decode(name, channels, lambda width, height: self._count <= width * height <= most)
        return pixels.reshape(-1, pixels.shape[2])[: self._count, :channels]

    def of_palette(self, name: str, palette: Palette) -> _Pixels:
        """[palette.count, palette.coefficients, 3]."""
        size = (PALETTE_WIDTH * palette.coefficients, math.ceil(palette.count / PALETTE_WIDTH))
        pixels = self._decode(name, 3, lambda width, height: width == size[0] and size[1] <= height <= 1024)
        return pixels[..., :3].reshape(-1, palette.coefficients, 3)[: palette.count]

    def _decode(self, name: str, channels: int, fits: Callable[[int, int], bool]) -> _Pixels:
        content = self._files.read(name, self._limit)
        size = _webp_size(content)
        if size is None:
            raise BrokenScene(f"{name} is no lossless WebP image.")
        if not fits(*size):
            raise BrokenScene(f"{name} has {size[0]} × {size[1]} pixels, which does not fit the scene's meta.json.")
        try:
            with WebPImagePlugin.WebPImageFile(io.BytesIO(content)) as image:
                if image.size != size:
                    raise BrokenScene(f"{name} contradicts itself about its size.")
                image.load()
                pixels = np.asarray(image if image.mode == "RGBA" or channels == 3 else image.convert("RGBA"))
        except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
            raise BrokenScene(f"{name} cannot be decoded: {str(error).rstrip('.')}.") from None
        return pixels


def _webp_size(content: bytes) -> tuple[int, int] | None:
    """Width and height, before anything is allocated for them; None if it is no WebP, or surely a lossy one."""
    if len(content) < 30 or content[:4] != b"RIFF" or content[8:12] != b"WEBP":
        return None
    if content[12:16] == LOSSLESS:
        bits = int.from_bytes(content[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if content[12:16] == EXTENDED:
        return int.from_bytes(content[24:27], "little") + 1, int.from_bytes(content[27:30], "little") + 1
    return None


def _means(columns: Columns, meta: SogMeta, images: _Images) -> None:
    low, high = meta.means.files
    columns.means[:] = images.of_gaussians(low, 3)
    upper = images.of_gaussians(high, 3)
    start, end = np.array(meta.means.mins), np.array(meta.means.maxs)
    for rows in columns.blocks():
        shares = (columns.means[rows] + 256.0 * upper[rows]) / 65535
        logarithms = start + (end - start) * shares
        with np.errstate(over="ignore"):  # what overflows is dropped
            columns.means[rows] = np.sign(logarithms) * np.expm1(np.abs(logarithms))


def _scales(columns: Columns, meta: SogMeta, images: _Images) -> None:
    with np.errstate(over="ignore"):
        scales = np.exp(np.array(meta.scales.codebook, np.float32))
    pixels = images.of_gaussians(meta.scales.files[0], 3)
    for rows in columns.blocks():
        columns.scales[rows] = scales[pixels[rows]]


def _quaternions(columns: Columns, meta: SogMeta, images: _Images) -> None:
    pixels = images.of_gaussians(meta.quats.files[0], 4)
    for rows in columns.blocks():
        tags = pixels[rows, 3]
        others = (pixels[rows, :3] / 255 * 2 - 1) / math.sqrt(2)
        quaternions = with_largest(others, np.maximum(tags, FIRST_TAG) - FIRST_TAG)
        columns.quaternions[rows] = np.where(tags[:, None] >= FIRST_TAG, quaternions, (1, 0, 0, 0))


def _colours(columns: Columns, meta: SogMeta, images: _Images) -> None:
    colours = np.array(meta.sh0.codebook, np.float32)
    pixels = images.of_gaussians(meta.sh0.files[0], 4)
    for rows in columns.blocks():
        columns.sh[rows, 0] = colours[pixels[rows, :3]]
        columns.opacities[rows] = pixels[rows, 3] / np.float32(255)


def _coefficients(columns: Columns, palette: Palette, images: _Images) -> None:
    centroids, labels = palette.files
    entries = np.array(palette.codebook, np.float32)[images.of_palette(centroids, palette)]
    pixels = images.of_gaussians(labels, 3)
    for rows in columns.blocks():
        chosen = pixels[rows, 0] + 256 * pixels[rows, 1].astype(np.int64)
        if (chosen >= palette.count).any():
            raise BrokenScene(f"{labels} chooses entry {chosen.max()} of a palette of {palette.count}.")
        columns.sh[rows, 1:] = entries[chosen]
