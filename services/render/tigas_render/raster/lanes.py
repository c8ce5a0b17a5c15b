"""Lanes: native threads that make frames by C calls, so that the event loop's thread is the only one to run Python.

A lane makes one frame at a time: its calls draw the frame, encode it and copy it to the host.
"""

from __future__ import annotations

import itertools
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import CodedDepth
from tigas_render.encode.images import encode_png
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer
from tigas_render.raster.native_threads import Calls, NativeThreads, Stopwatch

logger = logging.getLogger(__name__)


@dataclass
class FetchedImage(Image):
    """An image that the device has encoded in one format."""

    width: int
    height: int
    format: FrameFormat
    quality: int
    """Of a JPEG."""
    content: bytes
    """A JPEG, video planes or, for `png`, RGB pixels."""
    coded_depth: CodedDepth | None = None

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        """The encoded image. Raises ValueError for another format, or for a JPEG of another quality."""
        self._check(format)
        if format == "jpeg" and quality != self.quality:
            raise ValueError(f"the image was encoded at quality {self.quality}, not {quality}")
        return encode_png(self.to_host()) if format == "png" else self.content

    def to_host(self) -> NDArray[np.uint8]:
        """A copy of the pixels. Raises ValueError unless the format is `png`."""
        self._check("png")
        return np.frombuffer(self.content, np.uint8).reshape(self.height, self.width, 3).copy()

    def close(self) -> None:
        """Do nothing: the image holds no memory of its rasteriser."""

    def _check(self, format: FrameFormat) -> None:
        if format != self.format:
            raise ValueError(f"the image was encoded as {self.format}, not {format}")


class Job(ABC):
    """One frame as C calls, with the device's resources that it holds until it is closed."""

    @abstractmethod
    def calls(self) -> tuple[tuple[Calls, ...], tuple[Calls, ...]]:
        """The calls of one attempt: drawing calls; and calls that encode, copy to the host and wait."""

    @abstractmethod
    def fetched(self) -> FetchedImage | None:
        """The image, after all calls; None if the buffers were too small and have been enlarged for a new attempt."""

    @abstractmethod
    def explained(self) -> AbstractContextManager[None]:
        """A context that translates the device's errors into the service's."""

    @abstractmethod
    def close(self, *, failed: bool) -> None:
        """Release the resources. failed: the device may still be using them."""

    def run(self) -> FetchedImage:
        """Make the frame on the calling thread, and close the job."""
        failed = True
        try:
            with self.explained():
                image = None
                while image is None:
                    for calls in itertools.chain(*self.calls()):
                        calls.make()
                    image = self.fetched()
            failed = False
            return image
        finally:
            self.close(failed=failed)


class LaneRasterizer(Rasterizer):
    """A rasteriser with `frames_in_flight` lanes. `render` is for single pictures: previews, warm-up, tools, tests."""

    @abstractmethod
    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        """One view for a lane, to be started at once. Raises the errors of `render`. quality: of a JPEG."""

    def enter_thread(self) -> None:
        """Prepare the calling thread for a job's calls; called once in each lane."""

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
        quality: int = 90,
    ) -> FetchedImage:
        """Render and encode one view on the calling thread, without pauses. quality: of a JPEG."""
        return self.job(scene, camera, format, quality, depth=depth).run()


Finished = Callable[[FetchedImage | Exception], None]


class Lanes:
    """The lanes of a rasteriser, owned by one thread, which they never block."""

    def __init__(self, count: int, enter: Callable[[], None]) -> None:
        """enter: called once in each native thread."""
        self._threads = NativeThreads(count, enter)
        self._watches = [Stopwatch(3) for _ in range(count)]
        self._free = list(range(count))
        self._jobs: dict[int, tuple[Job, Finished]] = {}

    @property
    def free(self) -> int:
        """The number of idle lanes."""
        return len(self._free)

    def fileno(self) -> int:
        """A descriptor that is readable when there is something to `collect`."""
        return self._threads.fileno()

    def begin(self, job: Job, finished: Finished) -> None:
        """Make a frame in a free lane. `collect` reports the outcome and closes the job."""
        lane = self._free.pop()
        try:
            self._start(lane, job)
        except BaseException:
            self._free.append(lane)
            job.close(failed=True)
            raise
        self._jobs[lane] = (job, finished)

    def collect(self) -> None:
        """Report the outcomes of all finished frames, in arbitrary order."""
        results = [(self._jobs[lane][1], self._result(lane)) for lane in self._threads.ended()]
        for finished, result in results:  # after all lanes are free, in case a callback raises
            if result is not None:
                try:
                    finished(result)
                except Exception:
                    logger.exception("A frame was not delivered")

    def _result(self, lane: int) -> FetchedImage | Exception | None:
        """The outcome of a lane's job, which is then closed; None if it was restarted with larger buffers."""
        job, _ = self._jobs[lane]
        failed = True
        try:
            with job.explained():
                self._threads.check(lane)
                image = job.fetched()
                if image is None:
                    self._start(lane, job)
                    return None
            failed = False
            image.rendering, image.encoding = self._watches[lane].seconds()
            result: FetchedImage | Exception = image
        except Exception as error:
            result = error
        del self._jobs[lane]
        self._free.append(lane)
        try:
            job.close(failed=failed)
        except Exception as error:
            result = error
        return result

    def end(self) -> None:
        """Wait for the frames in flight and accept no more. Callable on any thread."""
        self._threads.end()

    def close(self) -> None:
        """Release the descriptors, after `end` and a last `collect`."""
        self._threads.close()

    def _start(self, lane: int, job: Job) -> None:
        with job.explained():
            began, drawn, done = self._watches[lane].readings
            draw, fetch = job.calls()
            self._threads.begin(lane, began, *draw, drawn, *fetch, done)
