"""Lanes: frames made by native threads, so that the event loop's is the only one that runs Python.

A lane has one frame at a time, as C calls that draw it and bring it to the host.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import CodedDepth
from tigas_render.encode.png import encode_png
from tigas_render.raster.base import Camera, Image, PreparedScene, Rasterizer
from tigas_render.raster.calls import Calls
from tigas_render.raster.native_threads import NativeThreads, Stopwatch


@dataclass
class FetchedImage(Image):
    """An image that is on the host already, in one format, and how long that took."""

    width: int
    height: int
    format: FrameFormat
    content: bytes
    """A JPEG, video's planes, or, for `png`, RGB pixels."""
    coded_depth: CodedDepth | None = None
    rendering: float = 0.0
    """Seconds."""
    encoding: float = 0.0
    """Seconds."""

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        """The content as it is, or as a PNG. Raises ValueError for another format."""
        if format != self.format:
            raise ValueError(f"the image was made as {self.format}, not as {format}")
        return encode_png(self.to_host()) if format == "png" else self.content

    def to_host(self) -> NDArray[np.uint8]:
        """A copy of the pixels. Raises ValueError unless the image was made as `png`."""
        if self.format != "png":
            raise ValueError(f"the image was made as {self.format}, not as pixels")
        return np.frombuffer(self.content, np.uint8).reshape(self.height, self.width, 3).copy()

    def close(self) -> None:
        """There is nothing to give back."""


class Job(ABC):
    """One frame as C calls, and what it holds on the device until it is closed."""

    @abstractmethod
    def calls(self) -> tuple[tuple[Calls, ...], tuple[Calls, ...]]:
        """What draws the frame; and what encodes it, brings it to the host, and waits for that. Anew for each try."""

    @abstractmethod
    def fetched(self) -> FetchedImage | None:
        """The image, once all calls have been made; None if there was too little room, and now there is more."""

    @abstractmethod
    def explained(self) -> AbstractContextManager[None]:
        """Turns the device's errors into sentences."""

    @abstractmethod
    def close(self, *, failed: bool) -> None:
        """Give back what it holds. failed: the calls may have ended before the device was done."""


class LaneRasterizer(Rasterizer):
    """A rasteriser whose frames lanes make; `render` is for who wants an image beside them."""

    lanes: int
    """Frames at a time."""

    @abstractmethod
    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        """One view, to be begun at once. As `render`, and raises what it raises. quality: of a JPEG."""

    def enter_thread(self) -> None:
        """Called once in each thread that makes a job's calls."""


Finished = Callable[[FetchedImage | Exception], None]


class Lanes:
    """All lanes of a rasteriser. Belongs to one thread, which is not kept waiting."""

    def __init__(self, count: int, enter: Callable[[], None]) -> None:
        """enter: called once in each native thread."""
        self._threads = NativeThreads(count, enter)
        self._watches = [Stopwatch(3) for _ in range(count)]
        self._free = list(range(count))
        self._jobs: dict[int, tuple[Job, Finished]] = {}

    @property
    def free(self) -> int:
        """How many have nothing to do."""
        return len(self._free)

    def fileno(self) -> int:
        """Readable once there is something to `collect`."""
        return self._threads.fileno()

    def begin(self, job: Job, finished: Finished) -> None:
        """Make a frame in a free lane. `collect` tells what came of it, and closes the job."""
        lane = self._free.pop()
        try:
            self._start(lane, job)
        except BaseException:
            self._free.append(lane)
            job.close(failed=True)
            raise
        self._jobs[lane] = (job, finished)

    def collect(self) -> None:
        """Tell what came of the frames that are done, in no order."""
        for lane in self._threads.ended():
            job, finished = self._jobs[lane]
            failed = True
            result: FetchedImage | Exception | None
            try:
                with job.explained():
                    self._threads.check(lane)
                    result = job.fetched()
                    if result is None:
                        self._start(lane, job)
                        continue
                failed = False
                result.rendering, result.encoding = self._watches[lane].seconds()
            except Exception as error:
                result = error
            del self._jobs[lane]
            self._free.append(lane)
            job.close(failed=failed)
            finished(result)

    def end(self) -> None:
        """Wait for what has begun; nothing can begin any more. On any thread."""
        self._threads.end()

    def close(self) -> None:
        """After `end`, and a last `collect`."""
        self._threads.close()

    def _start(self, lane: int, job: Job) -> None:
        with job.explained():
            began, drawn, done = self._watches[lane].readings
            draw, fetch = job.calls()
            self._threads.begin(lane, began, *draw, drawn, *fetch, done)
