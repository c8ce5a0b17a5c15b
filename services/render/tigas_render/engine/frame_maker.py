"""Frame makers, which take work from the queue, render it, encode the images, and answer.

A rasteriser with lanes (CUDA, synthetic frames) is driven from the event loop; the CPU rasteriser from threads.
"""

from __future__ import annotations

import asyncio
import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

from tigas_common.errors import DeadlineExceeded, Superseded, TigasError
from tigas_common.wire.render import FrameFormat, RenderRequest, ServerTiming
from tigas_render.encode.depth_segment import encode_depth, insert_depth
from tigas_render.encode.images import encode_webp
from tigas_render.encode.video_chains import VideoChains
from tigas_render.engine.work import CallbackQueue, Work
from tigas_render.engine.work_queue import WorkQueue
from tigas_render.frame import Frame
from tigas_render.raster.base import Image, Rasterizer
from tigas_render.raster.lanes import FetchedImage, LaneRasterizer, Lanes

logger = logging.getLogger(__name__)


SUFFICIENT_LANES: Final = 6
"""Number of concurrent frames that keeps a device busy."""
MAX_LANES_BUSY_S: Final = 0.05
"""Expected seconds of work in lanes above which only SUFFICIENT_LANES are used: for a slow device, requests should wait
in the queue, where newer ones can replace them."""


@dataclass(eq=False)
class FrameMaker(ABC):
    """Makes the frames of one rasteriser."""

    rasterizer: Rasterizer
    queue: WorkQueue
    clock: Callable[[], float]
    answer: Callable[[Work, Frame | Exception], None]
    """Called with the outcome of each work item, on any thread."""
    videos: VideoChains

    @abstractmethod
    async def start(self) -> None:
        """Warm up the rasteriser, then start taking work."""

    @abstractmethod
    async def stop(self) -> None:
        """Finish the frames in flight, once the queue is closed."""

    def _finish(self, work: Work, image: Image) -> None:
        """Encode and close the image, and answer. May be called on any thread."""
        request, size, rendering, encoded = work.request, work.size, image.rendering, image.encoding
        body, video = None, None
        try:
            with image:
                begun = self.clock()
                if not work.is_over:
                    work.check_deadline(begun)
                    body = _encode(work, image)
            if body is not None and request.video is not None:
                body, video = self.videos.encode(work.client, request.seq, request.video, size.width, size.height, body)
        except (DeadlineExceeded, Superseded) as error:
            self.queue.finish(work, rendering + self.clock() - begun + encoded)
            self.answer(work, error)
            return
        except Exception as error:
            self._fail("Encoding", work, error)
            return
        encoding = self.clock() - begun + encoded
        self.queue.finish(work, rendering + encoding, is_whole=body is not None and not work.scene.is_coarse)
        if body is None:
            return
        waiting = begun - work.arrived - rendering - encoded
        timing = ServerTiming.trusted({"queue": _ms(waiting), "render": _ms(rendering), "encode": _ms(encoding)})
        frame = Frame(
            body, request.format, size.width, size.height, request.seq, request.profile, timing,
            size.margin_x, size.margin_y, video, work.scene.is_coarse,
        )  # fmt: skip
        self.answer(work, frame)

    def _fail(self, step: str, work: Work, error: Exception) -> None:
        """Answer work that has begun with an error. step: the failed step, for the log."""
        self.queue.finish(work)
        if isinstance(error, TigasError):
            logger.error("%s %s failed: %s", step, work.request.scene, error.detail)
        else:
            logger.error("%s %s failed", step, work.request.scene, exc_info=error)
        self.answer(work, error)


class LaneFrameMaker(FrameMaker):
    """Starts a frame whenever a lane is free, and finishes JPEGs, all on the event loop.

    Lanes beyond SUFFICIENT_LANES keep the device busy while finished lanes wait for a busy event loop.
    Threads do the remaining work on the host, such as encoding video and WebP.
    """

    rasterizer: LaneRasterizer

    async def start(self) -> None:
        self._lanes_busy_s = 0.0  # expected seconds of frames in lanes
        self._on_host = 0  # images that the threads are encoding or about to encode
        self._is_scheduled = False  # whether the event loop is about to run `_start_all`
        self._loop = asyncio.get_running_loop()
        self._max_on_host = max(self.rasterizer.frames_in_flight, os.cpu_count() or 1)
        self._threads = ThreadPoolExecutor(self._max_on_host, "host")
        self._host_done: CallbackQueue[None] = CallbackQueue(self._handle_host_done)
        await self._loop.run_in_executor(self._threads, self.rasterizer.warm_up)
        self._lanes: Lanes | None = Lanes(self.rasterizer.frames_in_flight, self.rasterizer.enter_thread)
        self._loop.add_reader(self._lanes.fileno(), self._collect)
        self.queue.set_listener(self._schedule)
        self._start_all()  # starts waiting work; if there is no work, the queue notes that the renderer is idle

    async def stop(self) -> None:
        if self._lanes is not None:
            lanes, self._lanes = self._lanes, None
            self._loop.remove_reader(lanes.fileno())
            await self._loop.run_in_executor(self._threads, lanes.end)
            lanes.collect()
            lanes.close()
        await self._loop.run_in_executor(None, self._threads.shutdown)

    def _schedule(self) -> None:
        """Start new work soon, once for a burst of requests."""
        if not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon(self._start_all)

    def _start_all(self) -> None:
        self._is_scheduled = False
        while self._lanes is not None and self._can_start(self._lanes):
            work = self.queue.pop_nowait()
            if work is None:
                return
            self._start(self._lanes, work)

    def _can_start(self, lanes: Lanes) -> bool:
        if not lanes.free or self._on_host >= self._max_on_host:
            return False
        return lanes.busy < SUFFICIENT_LANES or self._lanes_busy_s < MAX_LANES_BUSY_S

    def _start(self, lanes: Lanes, work: Work) -> None:
        request = work.request
        try:
            camera = work.size.camera(request, work.scene.background)
            job = self.rasterizer.job(
                work.scene.prepared, camera, raster_format(request), work.quality, depth=wants_depth(request)
            )
            lanes.begin(job, partial(self._handle_fetched, work))
        except Exception as error:
            self._fail("Rendering", work, error)
        else:
            self._lanes_busy_s += work.expected

    def _collect(self) -> None:
        try:
            if self._lanes is not None:
                self._lanes.collect()
        finally:
            self._start_all()

    def _handle_fetched(self, work: Work, image: FetchedImage | Exception) -> None:
        self._lanes_busy_s -= work.expected
        if isinstance(image, Exception):
            self._fail("Rendering", work, image)
        elif image.format == "jpeg":
            self._finish(work, image)
        else:
            self._on_host += 1
            self._threads.submit(self._finish_on_host, work, image)

    def _finish_on_host(self, work: Work, image: FetchedImage) -> None:
        try:
            self._finish(work, image)
        finally:
            self._host_done.put(None)

    def _handle_host_done(self, _: None) -> None:
        self._on_host -= 1
        self._start_all()


class ThreadFrameMaker(FrameMaker):
    """Runs one thread for each frame in flight.

    The threads take turns to render, and each encodes its own image, so that under load no frame has to wake another
    thread. Work is chosen as late as possible, by a thread that can start it immediately.
    """

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._threads = ThreadPoolExecutor(self.rasterizer.frames_in_flight, "render")
        await loop.run_in_executor(self._threads, self.rasterizer.warm_up)
        self._running = [
            loop.run_in_executor(self._threads, self._run) for _ in range(self.rasterizer.frames_in_flight)
        ]

    async def stop(self) -> None:
        await asyncio.gather(*self._running)
        self._threads.shutdown()

    def _run(self) -> None:
        while self._make_next():  # a separate call, so that no reference keeps an unloaded scene alive while waiting
            pass

    def _make_next(self) -> bool:
        """Wait for work and make its frame. Returns False once the queue is closed."""
        work = self.queue.pop()
        if work is None:
            return False
        image = self._render(work, is_interruptible=True)
        self.queue.yield_turn()
        if image is not None:
            self._finish(work, image)
        return True

    def _render(self, work: Work, *, is_interruptible: bool) -> Image | None:
        """Render the image and set its rendering time without interruptions; None if rendering failed."""
        interrupted = 0.0

        def pause() -> None:
            nonlocal interrupted
            begun = self.clock()
            self._make_urgent(work)
            interrupted += self.clock() - begun

        request = work.request
        try:
            started = self.clock()
            image = self.rasterizer.render(
                work.scene.prepared,
                work.size.camera(request, work.scene.background),
                raster_format(request),
                pause if is_interruptible else None,
                depth=wants_depth(request),
            )
        except Exception as error:
            self._fail("Rendering", work, error)
            return None
        image.rendering = self.clock() - started - interrupted
        return image

    def _make_urgent(self, work: Work) -> None:
        """Make much cheaper frames of other clients before continuing with a frame in progress."""
        while (urgent := self.queue.pop_urgent(work)) is not None:
            image = self._render(urgent, is_interruptible=False)
            if image is not None:
                self._finish(urgent, image)


def wants_depth(request: RenderRequest) -> bool:
    return request.depth and request.format in ("jpeg", "webp")


def raster_format(request: RenderRequest) -> FrameFormat:
    """The format to request from the rasteriser."""
    match request.format:
        case "h264":
            return "yuv420p"
        case "webp":
            return "png"  # gives access to the pixels
        case format:
            return format


def _encode(work: Work, image: Image) -> bytes:
    """The frame's body. Rasterisers cannot encode WebP, so the host does."""
    if work.request.format == "webp":
        body = encode_webp(image.to_host(), work.quality)
    else:
        body = image.encode(raster_format(work.request), work.quality)
    depth = image.coded_depth
    if depth is None and image.depth is not None:
        depth = encode_depth(image.depth)
    return body if depth is None else insert_depth(body, depth)


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)
