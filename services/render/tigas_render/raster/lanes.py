"""Lanes: native threads that make frames with C calls, so that only the event loop's thread runs Python.

A lane makes one frame at a time: its calls draw the frame, encode it and copy it to the host. An eventfd starts it, and
another reports to the event loop. Ordinary Python threads are too slow for 100 viewers: with separate calls for
launches, encoding and readback, a thread acquires the GIL five times per frame (docs/results/2026-11-engine-cost.md).
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import CodedDepth
from tigas_render.encode.images import encode_png
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer
from tigas_render.raster.calls import (
    FAILED,
    IS_LAST,
    MAX_ARGUMENTS,
    MAX_CALLS,
    ROWS,
    STATUS,
    FrameCalls,
    serve,
)

logger = logging.getLogger(__name__)


@dataclass
class FetchedImage(Image):
    """An image that the device has encoded in one format."""

    width: int
    height: int
    format: FrameFormat
    quality: int
    """JPEG quality."""
    content: bytes
    """A JPEG, planes for video or, for `png`, RGB pixels."""
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

    def _check(self, format: FrameFormat) -> None:
        if format != self.format:
            raise ValueError(f"the image was encoded as {self.format}, not {format}")


class Job(ABC):
    """One frame as C calls, with the device resources that it holds until it is closed."""

    @abstractmethod
    def calls(self) -> FrameCalls:
        """The calls for one attempt. No other job uses them until this one is closed."""

    @abstractmethod
    def fetched(self) -> FetchedImage | None:
        """The image, after all calls; None if the buffers were too small and have been enlarged for another attempt."""

    def explained(self) -> AbstractContextManager[None]:
        """A context manager that translates the device's errors into the service's."""
        return nullcontext()

    def close(self, *, failed: bool) -> None:  # noqa: B027 - not every job holds any
        """Release the resources. failed: the device may still be using them."""

    def run(self) -> FetchedImage:
        """Make the frame on the calling thread, and close the job."""
        failed = True
        try:
            with self.explained():
                image = None
                while image is None:
                    self.calls().make()
                    image = self.fetched()
            failed = False
            return image
        finally:
            self.close(failed=failed)


class LaneRasterizer(Rasterizer):
    """A rasteriser with `frames_in_flight` lanes. `render` is for single images: previews, warm-up, tools and tests."""

    @abstractmethod
    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> Job:
        """Prepare one view for a lane, to be started immediately. quality: of a JPEG. Raises the errors of `render`."""

    def enter_thread(self) -> None:
        """Prepare the calling thread for a job's calls. Called once in each lane."""

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


OnFinished = Callable[[FetchedImage | Exception], None]


class _Lane:
    """A native thread that executes the calls of one job at a time."""

    def __init__(self, bit: int, done: int, enter: Callable[[], None]) -> None:
        self.bit = bit
        self.order = os.eventfd(0, os.EFD_CLOEXEC)
        self.calls: FrameCalls
        """The calls of the last job."""
        self._table = np.zeros((MAX_CALLS, 1 + MAX_ARGUMENTS), np.int64)
        self._state = np.zeros(4, np.int64)
        self.thread = threading.Thread(target=self._run, args=(done, enter), name=f"lane {bit}", daemon=True)
        self.thread.start()

    def begin(self, job: Job) -> None:
        """Start executing the job's calls in order, until one fails. Raises RuntimeError after `end`."""
        if self._state[IS_LAST]:
            raise RuntimeError("the lanes have ended")
        with job.explained():
            self.calls = job.calls()
        rows = self.calls.table
        self._table[: len(rows)] = rows
        self._state[ROWS] = len(rows)
        os.eventfd_write(self.order, 1)

    def check(self) -> None:
        """Raise the error of the failed call, if any."""
        status = int(self._state[STATUS])
        if status:
            raise self.calls.error(int(self._state[FAILED]), status)

    def end(self) -> None:
        """Let the thread exit after the current job and its report."""
        self._state[IS_LAST] = 1
        os.eventfd_write(self.order, 1)

    def _run(self, done: int, enter: Callable[[], None]) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # signals must not interrupt a call
        enter()
        serve(self.order, done, self.bit, self._table, self._state)


class Lanes:
    """The lanes of a rasteriser. They belong to one thread, which they never block."""

    def __init__(self, count: int, enter: Callable[[], None]) -> None:
        """count: at most 63. enter: called once in each native thread, and must not raise."""
        self._done = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._lanes = [_Lane(1 << number, self._done, enter) for number in range(count)]
        self._free = list(self._lanes)
        self._jobs: dict[_Lane, tuple[Job, OnFinished]] = {}

    @property
    def free(self) -> int:
        """Number of idle lanes."""
        return len(self._free)

    @property
    def busy(self) -> int:
        """Number of lanes with a frame."""
        return len(self._jobs)

    def fileno(self) -> int:
        """A file descriptor that is readable when there is something to `collect`."""
        return self._done

    def begin(self, job: Job, on_finished: OnFinished) -> None:
        """Make a frame in a free lane. `collect` reports the outcome and closes the job."""
        lane = self._free.pop()
        try:
            lane.begin(job)
        except BaseException:
            self._free.append(lane)
            job.close(failed=True)
            raise
        self._jobs[lane] = (job, on_finished)

    def collect(self) -> None:
        """Report the outcomes of all finished frames, in arbitrary order."""
        try:
            bits = os.eventfd_read(self._done)
        except BlockingIOError:
            return
        results = [(self._jobs[lane][1], self._finish_job(lane)) for lane in self._lanes if bits & lane.bit]
        for on_finished, result in results:  # once all lanes are free, so that a callback's error loses no lane
            if result is not None:
                try:
                    on_finished(result)
                except Exception:
                    logger.exception("A frame was not delivered")

    def _finish_job(self, lane: _Lane) -> FetchedImage | Exception | None:
        """The outcome of a lane's job, after closing it; None if the job was restarted with larger buffers."""
        job, _ = self._jobs[lane]
        failed = True
        try:
            with job.explained():
                lane.check()
                image = job.fetched()
                if image is None:
                    lane.begin(job)
                    return None
            failed = False
            image.rendering, image.encoding = lane.calls.seconds()
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
        """Wait for the frames in flight, and accept no more. May be called on any thread."""
        for lane in self._lanes:
            lane.end()
        for lane in self._lanes:
            lane.thread.join()

    def close(self) -> None:
        """Close the file descriptors, after `end` and a last `collect`."""
        for descriptor in (*(lane.order for lane in self._lanes), self._done):
            os.close(descriptor)
