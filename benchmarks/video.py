"""What a viewer's video costs and buys beside JPEGs: bytes at equal picture, processor time, key frames and switches.

    python -m benchmarks.video walk.csv [more.csv …] [--scene NAME=PLY …] [--cameras cameras.json] [--plot FILE.svg]

Renders a stretch of each movement in each scene at every size, and encodes it as JPEGs of several qualities and as
videos of several bit rates, for each of x264's presets, and by VP9 and AV1 as fast as they can; every picture is
compared with its own render before any compression. Times are processor time. Prints Markdown;
docs/video.md has the results.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import av
import numpy as np
import psutil
import typer
from PIL import Image

from benchmarks.formats.codecs import Picture, decoded
from benchmarks.formats.measure import Sample
from benchmarks.formats.report import at_picture, bjontegaard, psnr
from benchmarks.reprojection import scene_info, walked
from benchmarks.views import centred_lens, chosen
from tigas_common.pose import Pose
from tigas_render.encode.h264 import FRAMES_PER_S, PRESET, H264Encoder, Preset
from tigas_render.encode.jpeg import encode_jpeg
from tigas_render.encode.yuv420p import KB, KR, encode_yuv420p
from tigas_render.raster.base import Camera, PreparedScene
from tigas_render.raster.cpu import CpuRasterizer

SIZES = {(320, 180): (10, 35), (640, 360): (35, 65), (1280, 720): (35, 65)}
"""With the qualities of the JPEGs whose picture a video is to have."""
DISPLAY = 1280
QUALITIES = (10, 35, 65, 90)
BITS_PER_PIXEL = (0.025, 0.06, 0.15, 0.4, 1.0)
PRESETS: tuple[Preset, ...] = ("ultrafast", "superfast", "veryfast")
OTHERS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "VP9": ("libvpx-vp9", {"deadline": "realtime", "cpu-used": "8", "lag-in-frames": "0", "row-mt": "0"}),
    "AV1": ("libsvtav1", {"preset": "12", "svtav1-params": "pred-struct=1:rc=2:lp=1:lookahead=0"}),
}
"""Other encoders, and what is the fastest that they have for a picture at a time."""
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


def other_video(pictures: Sequence[Picture], bits: float, name: str, options: Mapping[str, str]) -> Run:
    """All pictures as one video by another encoder, at a constant rate."""
    height, width = pictures[0].shape[:2]
    encoder = av.CodecContext.create(name, "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt = width, height, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, FRAMES_PER_S), Fraction(FRAMES_PER_S)
    encoder.bit_rate = round(bits * FRAMES_PER_S)
    encoder.gop_size, encoder.thread_count = 2**20, 1
    rate = str(encoder.bit_rate)
    encoder.options = {**options, "minrate": rate, "maxrate": rate, "bufsize": str(encoder.bit_rate // 4)}
    decoder = av.CodecContext.create("vp9" if name == "libvpx-vp9" else "libdav1d", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    decoder.thread_count = 1
    decoder.options = {} if name == "libvpx-vp9" else {"max_frame_delay": "1"}
    run = []
    for number, picture in enumerate(pictures):

        def encode(number: int = number, picture: Picture = picture) -> bytes:
            rows = np.frombuffer(encode_yuv420p(picture), np.uint8).reshape(height * 3 // 2, width)
            frame = av.VideoFrame.from_ndarray(rows, format="yuv420p")
            frame.pts, frame.time_base = number, encoder.time_base
            (packet,) = encoder.encode(frame)
            return bytes(packet)

        body, ms = _timed(encode)
        (frame,) = decoder.decode(av.Packet(body))
        run.append(Coded(len(body), _error(_shown(frame), picture), ms))
    return run


def sample(codec: str, width: int, quality: float, runs: Sequence[Run]) -> Sample:
    """What runs have in common: mean size and time, PSNR of the mean error."""
    frames = [frame for run in runs for frame in run[SETTLED:]]
    size, error, ms = (
        float(np.mean([getattr(one, name) for one in frames])) for name in ("size", "error", "encode_ms")
    )
    return Sample(codec, width, quality, round(size), _psnr(error), 0.0, ms)


def curves(size: tuple[int, int], walks: Sequence[Sequence[Picture]]) -> dict[str, list[Sample]]:
    """By codec, from poor to good."""
    width, pixels = size[0], size[0] * size[1]
    found = {"JPEG": [sample("JPEG", width, quality, [jpegs(one, quality) for one in walks]) for quality in QUALITIES]}
    for preset in PRESETS:
        found[f"H.264 {preset}"] = [
            sample(preset, width, rate, [video(one, rate * pixels, preset) for one in walks]) for rate in BITS_PER_PIXEL
        ]
    for name, (encoder, options) in OTHERS.items():
        found[name] = [
            sample(name, width, rate, [other_video(one, rate * pixels, encoder, options) for one in walks])
            for rate in BITS_PER_PIXEL
        ]
    return {name: sorted(one, key=psnr) for name, one in found.items()}


def rate_table(found: dict[tuple[int, int], dict[str, list[Sample]]]) -> Iterator[str]:
    """What each preset needs for the picture of the ladder's JPEG."""
    yield "| size | | kB a frame | saved | on the whole curve | encode, ms | viewers a core at 60/s |"
    yield "|---|---|---|---|---|---|---|"
    for (width, height), codecs in found.items():
        for quality in SIZES[width, height]:
            jpeg = _of_quality(codecs["JPEG"], quality)
            for name, curve in codecs.items():
                size, ms = at_picture(curve, psnr, jpeg.psnr_db)
                cells = [f"JPEG q{quality}, {jpeg.psnr_db:.1f} dB", f"{size / 1000:.2f}", "", ""]
                if name != "JPEG":
                    whole = -bjontegaard(codecs["JPEG"], curve, psnr)
                    cells = [name, f"{size / 1000:.2f}", f"{1 - size / jpeg.size:.0%}", f"{whole:.0%}"]
                cells += [f"{ms:.2f}", f"{1000 / 60 / ms:.0f}"]
                yield f"| {width}×{height} | {' | '.join(cells)} |"


def break_table(size: tuple[int, int], walks: Sequence[Sequence[Picture]], bits: float) -> Iterator[str]:
    """What one more key frame costs, and another encoder, against the same frames without."""
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


def plot(found: dict[tuple[int, int], dict[str, list[Sample]]], file: Path) -> None:
    """PSNR over bytes, a panel for each size."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(found), figsize=(4 * len(found), 3.4), layout="constrained")
    for axis, ((width, height), codecs) in zip(np.atleast_1d(axes), found.items(), strict=True):
        for name, curve in codecs.items():
            axis.plot([one.size / 1000 for one in curve], [one.psnr_db for one in curve], marker=".", label=name)
        axis.set(title=f"{width}×{height}", xlabel="kB a frame", xscale="log")
        axis.grid(alpha=0.3)
    np.atleast_1d(axes)[0].set_ylabel("PSNR, dB")
    np.atleast_1d(axes)[0].legend(fontsize="small")
    figure.savefig(file)


def main(
    movements: Annotated[list[Path], typer.Argument(metavar="MOVEMENT…")],
    scene: Annotated[list[str] | None, typer.Option(metavar="NAME=PLY", help="Without: the courtyard.")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a start camera for each scene.")] = None,
    frames: Annotated[int, typer.Option(min=30, help="Of each movement in each scene.")] = 60,
    rate: Annotated[float, typer.Option(min=1, help="Frames a second.")] = 60,
    begin_s: Annotated[float, typer.Option(min=0, help="Where in a movement the stretch begins.")] = 5,
    svg: Annotated[Path | None, typer.Option("--plot", help="Where to draw the curves.")] = None,
) -> None:
    """Measure, and print tables."""
    rasterizer = CpuRasterizer()
    times = 1000 * (begin_s + np.arange(frames) / rate)
    places = [
        (rasterizer.prepare(gaussians), [walked(path, scene_info(name, view)) for path in movements])
        for name, gaussians, view in chosen(scene, cameras)
    ]
    found, breaks, memory = {}, list[str](), list[str]()
    for size in SIZES:
        typer.echo(f"{size[0]}×{size[1]} …", err=True)
        walks = [
            stretch(rasterizer, scene, [walk.pose(float(at)) for at in times], size)
            for scene, own in places
            for walk in own
        ]
        found[size] = curves(size, walks)
        for quality in SIZES[size]:
            wanted = _of_quality(found[size]["JPEG"], quality).psnr_db
            bits = 8 * at_picture(found[size][f"H.264 {PRESET}"], psnr, wanted)[0]
            breaks += break_table(size, walks, bits)
        memory.append(f"{size[0]}×{size[1]}: {memory_mb(size, walks[0], bits):.1f} MB")
    for line in rate_table(found):
        typer.echo(line)
    typer.echo("\n| | | its bytes / usual | largest of ten / usual | lower by, dB | frames until near | encode, ms |")
    typer.echo("|---|---|---|---|---|---|---|")
    for line in breaks:
        typer.echo(line)
    typer.echo(f"\nMemory of an encoder: {', '.join(memory)}.")
    if svg is not None:
        plot(found, svg)


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
    typer.run(main)
