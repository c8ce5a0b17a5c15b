"""Bytes saved by WebP relative to the service's JPEGs, at each rung of the ladder, and its cost in quality.

    python -m benchmarks.formats [NAME=PLY …] [--cameras cameras.json]

Without a scene it uses the built-in courtyard. Both are encoded like in the service, at the rung's own quality, and
compared with the render before any compression. Times are processor time of one thread. Results:
docs/results/2026-11-formats.md.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.views import centred_lens, chosen, look
from tigas_common.command import POSITIONAL, Command, Metavar, parse
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_experiments.quality.picture import compare
from tigas_render.encode.images import encode_jpeg, encode_webp
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer

Picture = NDArray[np.uint8]
DISPLAY = 1280
REPEATS = 3
"""Number of repetitions, of which the fastest counts: other load on the machine can only add time."""


def decoded(encoded: bytes) -> Picture:
    """RGB pixels [H, W, 3]."""
    with Image.open(io.BytesIO(encoded)) as image:
        return np.asarray(image.convert("RGB"))


class Formats(Command):
    """Print a line for each scene and rung."""

    scenes: Annotated[tuple[str, ...], POSITIONAL, Metavar("NAME=PLY")] = ()
    """Scenes; the courtyard unless given."""
    cameras: Path | None = None
    """JSON with a camera for each scene."""

    def run(self) -> None:
        rasterizer = CpuRasterizer()
        for name, gaussians, view in chosen(list(self.scenes), self.cameras):
            scene = rasterizer.prepare(gaussians)
            for rung in DEFAULT_LADDER:
                camera = Camera(look(view), centred_lens(rung.width, rung.height), display_scale=DISPLAY / rung.width)
                with rasterizer.render(scene, camera) as image:
                    pixels = image.to_host().copy()
                jpeg, jpeg_ms = _timed(encode_jpeg, pixels, rung.quality)
                webp, webp_ms = _timed(encode_webp, pixels, rung.quality)
                before, now = compare(decoded(jpeg), pixels), compare(decoded(webp), pixels)
                gains = f"PSNR {now.psnr_db - before.psnr_db:+.1f} dB, SSIM {now.ssim - before.ssim:+.3f}"
                bytes_ = f"{len(jpeg) / 1000:.1f} → {len(webp) / 1000:.1f} kB ({len(webp) / len(jpeg) - 1:+.0%})"
                about = f"{name} {rung.width}×{rung.height} q{rung.quality}"
                print(f"{about}: {bytes_}, {gains}, {jpeg_ms:.1f} → {webp_ms:.1f} ms")


def _timed(encode: Callable[[Picture, int], bytes], pixels: Picture, quality: int) -> tuple[bytes, float]:
    """Its result, and its minimum time in milliseconds."""
    times = []
    for _ in range(REPEATS):
        start = time.thread_time()
        encoded = encode(pixels, quality)
        times.append(time.thread_time() - start)
    return encoded, 1000 * min(times)


if __name__ == "__main__":
    parse(Formats, "benchmarks.formats", sys.argv[1:]).run()
