"""VMAF and VIFp of a sequence of pictures, computed by libvmaf from lossless videos in one pass.

VMAF also considers neighbouring frames (the motion in the ground truth), so pictures are passed as an ordered video.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import av
from av.video.stream import VideoStream

from tigas_common.errors import StartError
from tigas_common.installation import install_command
from tigas_common.parsing import quotable
from tigas_common.resources import usable_processors
from tigas_experiments.errors import MetricUnavailable
from tigas_experiments.quality.picture import Picture

FRAMES_PER_S = 30
TO_LUMA = "scale=out_color_matrix=bt709:out_range=limited:flags=bicubic+accurate_rnd+full_chroma_int,format=yuv444p"
LIBVMAF = r"libvmaf=model=version=vmaf_v0.6.1:feature='name=float_vif\:debug=true':log_fmt=json:log_path=log.json"
LOG, DISTORTED, TRUTH = "log.json", "distorted.mkv", "truth.mkv"


def ffmpeg() -> str:
    """Path of an ffmpeg with libvmaf. Raises MetricUnavailable."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        program = str(get_ffmpeg_exe())
        listed = subprocess.run([program, "-hide_banner", "-filters"], capture_output=True, text=True, check=False)
    except (ImportError, RuntimeError, OSError):
        raise MetricUnavailable(
            f"VMAF and VIFp are left out, because ffmpeg is missing: {install_command('lab')}"
        ) from None
    if " libvmaf " not in listed.stdout:
        raise MetricUnavailable(f"VMAF and VIFp are left out, because {program} has no libvmaf.")
    return program


def vmaf_and_vif(frames: Iterable[tuple[int, Picture, Picture]]) -> dict[int, tuple[float, float]]:
    """(VMAF, VIFp) of numbered pictures against their ground truths, all of one size, in display order.

    VMAF ranges from 0 to 100, and equal pictures score slightly below 100. VIFp is Sheikh and Bovik's visual
    information fidelity (IEEE TIP 15, 2006) in the pixel domain, over four scales of luma: 1 for equal pictures, more
    for pictures with more contrast than the truth. Raises MetricUnavailable, and StartError if ffmpeg fails.
    """
    program = ffmpeg()
    numbers: list[int] = []
    with TemporaryDirectory(prefix="tigas-vmaf-") as scratch:
        folder = Path(scratch)
        with lossless_video(folder / DISTORTED) as add, lossless_video(folder / TRUTH) as add_truth:
            for number, picture, truth in frames:
                if picture.shape != truth.shape:
                    raise ValueError(f"pictures of {picture.shape} and {truth.shape} cannot be compared")
                numbers.append(number)
                add(picture)
                add_truth(truth)
        if not numbers:
            return {}
        graph = f"[0:v]{TO_LUMA}[d];[1:v]{TO_LUMA}[t];[d][t]{LIBVMAF}:n_threads={usable_processors()}"
        asked = ("-i", DISTORTED, "-i", TRUTH, "-lavfi", graph, "-f", "null", "-")
        ended = subprocess.run(
            [program, "-hide_banner", "-nostdin", "-loglevel", "error", *asked],
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        found = []
        with suppress(OSError, ValueError):
            found = [frame["metrics"] for frame in json.loads((folder / LOG).read_text())["frames"]]
        if ended.returncode or len(found) != len(numbers):
            said = quotable(ended.stderr.strip(), 200) or f"exit status {ended.returncode}"
            raise StartError(f"ffmpeg could not compute VMAF: {said}")
        return {number: (metrics["vmaf"], metrics["vif"]) for number, metrics in zip(numbers, found, strict=True)}


@contextmanager
def lossless_video(path: Path) -> Iterator[Callable[[Picture], None]]:
    """Write pictures of one size as bit-exact RGB FFV1 in Matroska. Yields a function that adds a picture."""
    with av.open(path, "w", format="matroska") as container:
        stream: VideoStream | None = None

        def add(picture: Picture) -> None:
            nonlocal stream
            if stream is None:
                stream = container.add_stream("ffv1", rate=FRAMES_PER_S)
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt = "bgr0"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))

        yield add
        if stream is not None:
            container.mux(stream.encode())
