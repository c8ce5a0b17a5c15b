"""Cost and gain of a viewer's video against JPEGs: bytes at equal quality, processor time, key frames and
switches.

    python -m benchmarks.video walk.csv [more.csv …] [--scene NAME=PLY …] [--cameras cameras.json]

Renders a stretch of each movement in each scene at every size, and encodes it as JPEGs of several qualities and as
videos of several bit rates, for each of x264's presets; every picture is compared with its own render before any
compression. Times are processor time. Prints Markdown; docs/results/2026-11-video.md has results.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import av
import numpy as np
import psutil
from PIL import Image
from pydantic import Field
from scipy.interpolate import PchipInterpolator

from benchmarks.formats import Picture, decoded
from benchmarks.views import View, centred_lens, chosen
from tigas_common.command import POSITIONAL, Command, Metavar, parse
from tigas_common.pose import Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.movement.trace import MovementTrace, placed
from tigas_render.encode.h264 import PRESET, H264Encoder, Preset
from tigas_render.encode.images import KB, KR, encode_jpeg, encode_yuv420p
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.cpu import CpuRasterizer

SIZES = {(320, 180): (10, 35), (640, 360): (35, 65), (1280, 720): (35, 65)}
"""JPEG qualities that the compared videos match."""
DISPLAY = 1280
QUALITIES = (10, 35, 65, 90)
BITS_PER_PIXEL = (0.025, 0.06, 0.15, 0.4, 1.0)
PRESETS: tuple[Preset, ...] = ("ultrafast", "superfast", "veryfast")
SETTLED = 10
"""Frames before which nothing is counted: a walk does not begin every second."""
NEAR_DB = 0.3
ENCODERS = 16
"""That memory is measured with."""


@dataclass(frozen=True)
class Coded:
    """One frame."""

    size: int
    """Bytes."""
    error: float
    """Mean squared, of 8-bit RGB."""
    encode_ms: float

    @property
    def psnr_db(self) -> float:
        """Of the picture."""
        return _psnr(self.error)


Run = list[Coded]


@dataclass(frozen=True)
class Sample:
    """Several runs at one setting."""

    quality: float
    """JPEG's, or bits a pixel."""
    size: int
    """Bytes of a frame."""
    psnr_db: float
    encode_ms: float


def walked(path: Path, name: str, view: View) -> MovementTrace:
    """A movement's file, placed in a scene as experiments place it."""
    (x, y, z), (a, b, c), (i, j, k) = view["position"], view["look_at"], view["up"]
    info = SceneInfo(
        id=name, name=name, state="loaded", error=None, gaussians=None, sh_degree=None, file_bytes=0, memory_bytes=0,
        preview="", up=(i, j, k), camera=StartCamera(position=(x, y, z), look_at=(a, b, c)), background=(0, 0, 0),
    )  # fmt: skip
    points = placed(MovementTrace.read(path), info)
    times, positions, quaternions = (
        np.array([point[key] for point in points]) for key in ("t_ms", "position", "quaternion")
    )
    return MovementTrace(times, positions, quaternions, "scene", "scene")


def poses(walk: MovementTrace, times_ms: Sequence[float]) -> Iterator[Pose]:
    """Where the viewer is at each of these times."""
    for (x, y, z), (qx, qy, qz, qw) in zip(*(each.tolist() for each in walk.poses_at(times_ms)), strict=True):
        yield Pose.from_quaternion((x, y, z), (qx, qy, qz, qw))


def stretch(
    rasterizer: CpuRasterizer, scene: PreparedScene, poses: Iterable[Pose], size: tuple[int, int]
) -> list[Picture]:
    """The views from poses at a size."""
    lens = centred_lens(*size)
    pictures = []
    for pose in poses:
        with rasterizer.render(scene, Camera(pose, lens, display_scale=DISPLAY / size[0])) as image:
            pictures.append(image.to_host().copy())
    return pictures


def jpegs(pictures: Sequence[Picture], quality: int) -> Run:
    """Every picture by itself."""
    run = []
    for picture in pictures:
        body, ms = _timed(lambda picture=picture: encode_jpeg(picture, quality))  # type: ignore[misc]
        run.append(Coded(len(body), _error(decoded(body), picture), ms))
    return run


def video(
    pictures: Sequence[Picture], bits: float, preset: Preset = PRESET, *, key_at: int = 0, new_at: int | None = None
) -> Run:
    """All pictures as one video, with one more key frame, or another encoder from some picture on."""
    height, width = pictures[0].shape[:2]
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    decoder.thread_count = 1
    encoder = H264Encoder(width, height, bits, preset)
    run = []
    for number, picture in enumerate(pictures):

        def encode(number: int = number, picture: Picture = picture) -> bytes:
            nonlocal encoder
            if number == new_at:
                encoder = H264Encoder(width, height, bits, preset)
            return encoder.encode(encode_yuv420p(picture), bits, key=number == key_at).body

        body, ms = _timed(encode)
        (frame,) = decoder.decode(av.Packet(body))
        run.append(Coded(len(body), _error(_shown(frame), picture), ms))
    return run


def sample(quality: float, runs: Sequence[Run]) -> Sample:
    """Common figures of runs: mean size and time, PSNR of the mean error."""
    frames = [frame for run in runs for frame in run[SETTLED:]]
    size, error, ms = (
        float(np.mean([getattr(one, name) for one in frames])) for name in ("size", "error", "encode_ms")
    )
    return Sample(quality, round(size), _psnr(error), ms)


def curves(size: tuple[int, int], walks: Sequence[Sequence[Picture]]) -> dict[str, list[Sample]]:
    """By codec, from poor to good."""
    pixels = size[0] * size[1]
    found = {"JPEG": [sample(quality, [jpegs(one, quality) for one in walks]) for quality in QUALITIES]}
    for preset in PRESETS:
        found[f"H.264 {preset}"] = [
            sample(rate, [video(one, rate * pixels, preset) for one in walks]) for rate in BITS_PER_PIXEL
        ]
    return {name: sorted(one, key=lambda each: each.psnr_db) for name, one in found.items()}


def at_picture(samples: Sequence[Sample], wanted_db: float) -> tuple[float, float]:
    """Bytes and milliseconds at the wanted quality, or at the curve's end if that is better."""
    known = [each.psnr_db for each in samples]
    size = np.interp(wanted_db, known, np.log([each.size for each in samples]))
    return math.exp(size), float(np.interp(wanted_db, known, [each.encode_ms for each in samples]))


def bjontegaard(anchor: Sequence[Sample], other: Sequence[Sample]) -> float:
    """How many more bytes the other needs at equal picture, as a share (VCEG-M33, with monotone cubic pieces).

    Averaged over the picture's range that both have.
    """
    low = max(anchor[0].psnr_db, other[0].psnr_db)
    high = min(anchor[-1].psnr_db, other[-1].psnr_db)
    means = []
    for samples in (anchor, other):
        rate = PchipInterpolator([each.psnr_db for each in samples], np.log([each.size for each in samples]))
        means.append(float(rate.integrate(low, high)) / (high - low))
    return math.exp(means[1] - means[0]) - 1


def rate_table(found: dict[tuple[int, int], dict[str, list[Sample]]]) -> Iterator[str]:
    """Cost of each preset at the quality of the ladder's JPEG."""
    yield "| size | | kB a frame | saved | on the whole curve | encode, ms | viewers a core at 60/s |"
    yield "|---|---|---|---|---|---|---|"
    for (width, height), codecs in found.items():
        for quality in SIZES[width, height]:
            jpeg = _of_quality(codecs["JPEG"], quality)
            for name, curve in codecs.items():
                size, ms = at_picture(curve, jpeg.psnr_db)
                cells = [f"JPEG q{quality}, {jpeg.psnr_db:.1f} dB", f"{size / 1000:.2f}", "", ""]
                if name != "JPEG":
                    whole = -bjontegaard(codecs["JPEG"], curve)
                    cells = [name, f"{size / 1000:.2f}", f"{1 - size / jpeg.size:.0%}", f"{whole:.0%}"]
                cells += [f"{ms:.2f}", f"{1000 / 60 / ms:.0f}"]
                yield f"| {width}×{height} | {' | '.join(cells)} |"


def break_table(size: tuple[int, int], walks: Sequence[Sequence[Picture]], bits: float) -> Iterator[str]:
    """Cost of an additional key frame, and of another encoder, against the same frames without."""
    at = len(walks[0]) // 2
    plain = [video(one, bits) for one in walks]
    for name, runs in (
        ("key frame", [video(one, bits, key_at=at) for one in walks]),
        ("another encoder", [video(one, bits, new_at=at) for one in walks]),
    ):
        pairs = list(zip(runs, plain, strict=True))
        usual = np.mean([frame.size for run in plain for frame in run[SETTLED:]])
        sizes = np.mean([run[at].size for run in runs]) / usual
        largest = max(frame.size for run in runs for frame in run[at : at + 10]) / usual
        drop = np.mean([was[at].psnr_db - run[at].psnr_db for run, was in pairs])
        frames = np.mean([_until_near(run, was, at) for run, was in pairs])
        longer = np.mean([run[at].encode_ms - was[at].encode_ms for run, was in pairs])
        yield (
            f"| {size[0]}×{size[1]}, {60 * bits / 1e6:.1f} Mbit/s | {name} | {sizes:.2f} | {largest:.2f} | {drop:.1f} "
            f"| {frames:.0f} | {longer:+.1f} |"
        )


def memory_mb(size: tuple[int, int], pictures: Sequence[Picture], bits: float) -> float:
    """Resident megabytes of one encoder."""
    process, before = psutil.Process(), psutil.Process().memory_info().rss
    encoders = [H264Encoder(*size, bits) for _ in range(ENCODERS)]
    for encoder in encoders:
        for picture in pictures[:3]:
            encoder.encode(encode_yuv420p(picture), bits, key=False)
    return (process.memory_info().rss - before) / ENCODERS / 1e6


class Video(Command):
    """Measure, and print tables."""

    movements: Annotated[tuple[Path, ...], POSITIONAL, Metavar("MOVEMENT")]
    """Movement traces."""
    scenes: Annotated[tuple[str, ...], Metavar("NAME=PLY")] = ()
    """Scene; the courtyard unless given."""
    cameras: Path | None = None
    """JSON with a start camera for each scene."""
    frames: Annotated[int, Field(ge=30)] = 60
    """Frames of each movement in each scene."""
    rate: Annotated[float, Field(ge=1)] = 60
    """Frames a second."""
    begin_s: Annotated[float, Field(ge=0)] = 5
    """Position in a movement where the stretch begins."""

    def run(self) -> None:
        rasterizer = CpuRasterizer()
        times = [1000 * (self.begin_s + number / self.rate) for number in range(self.frames)]
        places = [
            (rasterizer.prepare(gaussians), [walked(path, name, view) for path in self.movements])
            for name, gaussians, view in chosen(list(self.scenes), self.cameras)
        ]
        found, breaks, memory = {}, list[str](), list[str]()
        for size in SIZES:
            print(f"{size[0]}×{size[1]} …", file=sys.stderr)
            walks = [stretch(rasterizer, scene, poses(walk, times), size) for scene, own in places for walk in own]
            found[size] = curves(size, walks)
            for quality in SIZES[size]:
                wanted = _of_quality(found[size]["JPEG"], quality).psnr_db
                bits = 8 * at_picture(found[size][f"H.264 {PRESET}"], wanted)[0]
                breaks += break_table(size, walks, bits)
            memory.append(f"{size[0]}×{size[1]}: {memory_mb(size, walks[0], bits):.1f} MB")
        for line in rate_table(found):
            print(line)
        print("\n| | | its bytes / usual | largest of ten / usual | lower by, dB | frames until near | encode, ms |")
        print("|---|---|---|---|---|---|---|")
        for line in breaks:
            print(line)
        print(f"\nMemory of an encoder: {', '.join(memory)}.")


def _of_quality(curve: Sequence[Sample], quality: int) -> Sample:
    return next(one for one in curve if one.quality == quality)


def _until_near(run: Run, plain: Run, at: int) -> int:
    """Frames from the break until the picture is nearly as good as without."""
    for number in range(at, len(run)):
        if run[number].psnr_db > plain[number].psnr_db - NEAR_DB:
            return number - at
    return len(run) - at


def _shown(frame: av.VideoFrame) -> Picture:
    """RGB, with chroma between the pixels of luma, as it is encoded and as a browser shows it."""
    planes, size = frame.to_ndarray(), (frame.width, frame.height)
    chroma = planes[frame.height :].reshape(2, frame.height // 2, frame.width // 2)
    blue, red = (
        np.asarray(Image.fromarray(one).resize(size, Image.Resampling.BILINEAR), np.float32) - 128 for one in chroma
    )
    luma = (planes[: frame.height].astype(np.float32) - 16) * (255 / 219)
    blue, red = blue * (255 / 224) * 2 * (1 - KB), red * (255 / 224) * 2 * (1 - KR)
    green = -(KR * red + KB * blue) / (1 - KR - KB)
    return np.stack([luma + red, luma + green, luma + blue], -1).round().clip(0, 255).astype(np.uint8)


def _timed(encode: Callable[[], bytes]) -> tuple[bytes, float]:
    start = time.process_time()
    body = encode()
    return body, 1000 * (time.process_time() - start)


def _error(shown: Picture, truth: Picture) -> float:
    return float(np.mean(np.square(shown.astype(np.float32) - truth)))


def _psnr(error: float) -> float:
    return float(10 * np.log10(255**2 / max(error, 1e-3)))


if __name__ == "__main__":
    parse(Video, "benchmarks.video", sys.argv[1:]).run()
