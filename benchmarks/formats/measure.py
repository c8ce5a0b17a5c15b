"""Bytes, picture and times of every codec at every size, on one scene."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.formats.browser import decode_times
from benchmarks.formats.codecs import TODAY, Codec, Picture, codecs, decoded
from benchmarks.views import View, centred_lens, look
from tigas_common.wire.render import DEFAULT_LADDER, Rung
from tigas_experiments.quality.picture import compare
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer

DISPLAY = 1280
REPEATS = 3
"""The least time of so many is taken: what the machine does beside it only ever adds."""


@dataclass(frozen=True)
class Sample:
    """One codec at one size and quality."""

    codec: str
    width: int
    quality: float
    size: int
    """Bytes."""
    psnr_db: float
    ssim: float
    encode_ms: float
    """Processor time of one thread."""


@dataclass(frozen=True)
class Decoding:
    """What a browser took from bytes to a bitmap, at the picture of the rung's JPEG."""

    codec: str
    width: int
    milliseconds: float


@dataclass(frozen=True)
class Measured:
    """One scene."""

    scene: str
    samples: list[Sample]
    decoding: list[Decoding]

    def write(self, folder: Path) -> None:
        """Into a file of the scene's name."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{self.scene}.json").write_text(json.dumps(dataclasses.asdict(self)))

    @classmethod
    def read(cls, file: Path) -> Measured:
        """What `write` wrote."""
        found = json.loads(file.read_text())
        samples = [Sample(**each) for each in found["samples"]]
        return cls(found["scene"], samples, [Decoding(**each) for each in found["decoding"]])


def rendered(gaussians: Gaussians, view: View) -> Iterator[tuple[Rung, Picture]]:
    """What the service would encode at each rung of the ladder."""
    rasterizer = CpuRasterizer()
    scene = rasterizer.prepare(gaussians)
    for rung in DEFAULT_LADDER:
        camera = Camera(look(view), centred_lens(rung.width, rung.height), display_scale=DISPLAY / rung.width)
        with rasterizer.render(scene, camera) as image:
            yield rung, image.to_host().copy()


def measure(name: str, gaussians: Gaussians, view: View, told: Callable[[str], None]) -> Measured:
    """All sizes of the ladder, each against its own render before any compression."""
    samples, bodies, wanted = list[Sample](), list[tuple[str, int, str, bytes]](), 0.0
    for rung, pixels in rendered(gaussians, view):
        told(f"{name} {rung.width}×{rung.height}")
        for codec in codecs():
            curve = [_sample(codec, quality, pixels) for quality in codec.qualities]
            samples += [sample for sample, _ in curve]
            if codec.name == TODAY:
                wanted = next(sample.psnr_db for sample, _ in curve if sample.quality == rung.quality)
            _, body = min(curve, key=lambda each: abs(each[0].psnr_db - wanted))
            bodies.append((codec.name, rung.width, codec.mime, body))
    told(f"{name} in the browser")
    times = decode_times([(mime, body) for _, _, mime, body in bodies])
    decoding = [
        Decoding(codec, width, each)
        for (codec, width, _, _), each in zip(bodies, times, strict=True)
        if each is not None
    ]
    return Measured(name, samples, decoding)


def _sample(codec: Codec, quality: float, pixels: Picture) -> tuple[Sample, bytes]:
    """What was measured, and the picture itself."""
    encoded, seconds = _timed(lambda: codec.encode(pixels, quality))
    found = compare(decoded(encoded), pixels)
    width = pixels.shape[1]
    return Sample(codec.name, width, quality, len(encoded), found.psnr_db, found.ssim, 1000 * seconds), encoded


def _timed(encode: Callable[[], bytes]) -> tuple[bytes, float]:
    """What it gives, and the least time that it took, in seconds of this thread's processor time."""
    times = []
    for _ in range(REPEATS):
        start = time.thread_time()
        encoded = encode()
        times.append(time.thread_time() - start)
    return encoded, min(times)
