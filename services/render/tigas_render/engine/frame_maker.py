"""Frame makers: take work from the queue, render it, and pass the images to the encoder stage.

A rasteriser with lanes (CUDA, synthetic frames) is driven from the event loop; the CPU rasteriser by threads.
"""

from __future__ import annotations

import asyncio
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from tigas_render.engine.callback_queue import CallbackQueue
from tigas_render.engine.encoder_stage import EncoderStage, has_depth, picture_format
from tigas_render.engine.work import Work
from tigas_render.engine.work_queue import WorkQueue
from tigas_render.raster.base import Image, Rasterizer
from tigas_render.raster.lanes import FetchedImage, LaneRasterizer, Lanes


class FrameMaker(ABC):
    """Makes the frames of one rasteriser."""

    @abstractmethod
    async def start(self) -> None:
        """Warm up the rasteriser, then begin to take work."""

    @abstractmethod
    async def stop(self) -> None:
        """Finish the frames in flight, once the queue is closed."""


def frame_maker(
    rasterizer: Rasterizer, queue: WorkQueue, clock: Callable[[], float], encoder: EncoderStage
) -> FrameMaker:
    """The frame maker that suits a rasteriser."""
    if isinstance(rasterizer, LaneRasterizer):
        return LaneFrameMaker(rasterizer, queue, encoder)
    return ThreadFrameMaker(rasterizer, queue, clock, encoder)


class LaneFrameMaker(FrameMaker):
    """Starts a frame whenever a lane is free, and finishes JPEGs, on the event loop.

    Threads do the remaining work on the host, such as video and WebP.
    """

    def __init__(self, rasterizer: LaneRasterizer, queue: WorkQueue, encoder: EncoderStage) -> None:
        self._rasterizer = rasterizer
        self._queue = queue
        self._encoder = encoder
        self._loop = asyncio.get_running_loop()
        threads = max(rasterizer.frames_in_flight, os.cpu_count() or 1)
        self._threads = ThreadPoolExecutor(threads, "host")
        self._on_host = 0
        """Images that the threads encode or will encode."""
        self._most_on_host = threads
        self._left_host: CallbackQueue[None] = CallbackQueue(self._leave_host)
        self._lanes: Lanes | None = None
        self._is_scheduled = False
        """Whether the event loop is about to run `_begin_all`."""

    async def start(self) -> None:
        await self._loop.run_in_executor(self._threads, self._rasterizer.warm_up)
        self._lanes = Lanes(self._rasterizer.frames_in_flight, self._rasterizer.enter_thread)
        self._loop.add_reader(self._lanes.fileno(), self._collect)
        self._queue.on_work(self._schedule)
        self._begin_all()  # work that is already waiting; otherwise the queue learns that the renderer is idle

    async def stop(self) -> None:
        if self._lanes is not None:
            lanes, self._lanes = self._lanes, None
            self._loop.remove_reader(lanes.fileno())
            await self._loop.run_in_executor(self._threads, lanes.end)
            lanes.collect()
            lanes.close()
        await self._loop.run_in_executor(None, self._threads.shutdown)

    def _schedule(self) -> None:
        """Start new work soon; once for a burst of requests."""
        if not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon(self._begin_all)

    def _begin_all(self) -> None:
        self._is_scheduled = False
        while self._lanes is not None and self._lanes.free and self._on_host < self._most_on_host:
            work = self._queue.take()
            if work is None:
                return
            self._begin(self._lanes, work)

    def _begin(self, lanes: Lanes, work: Work) -> None:
        request = work.request
        try:
            camera = work.size.camera(request, work.scene.background)
            quality = work.ladder[request.profile or 0].quality
            job = self._rasterizer.job(
                work.scene.prepared, camera, picture_format(request), quality, depth=has_depth(request)
            )
            lanes.begin(job, partial(self._fetched, work))
        except Exception as error:
            self._encoder.failed("Rendering", work, error)

    def _collect(self) -> None:
        try:
            if self._lanes is not None:
                self._lanes.collect()
        finally:
            self._begin_all()

    def _fetched(self, work: Work, image: FetchedImage | Exception) -> None:
        if isinstance(image, Exception):
            self._encoder.failed("Rendering", work, image)
        elif image.format == "jpeg":
            self._encoder.finish(work, image)
        else:
            self._on_host += 1
            self._threads.submit(self._finish_on_host, work, image)

    def _finish_on_host(self, work: Work, image: FetchedImage) -> None:
        try:
            self._encoder.finish(work, image)
        finally:
            self._left_host.put(None)

    def _leave_host(self, _: None) -> None:
        self._on_host -= 1
        self._begin_all()


class ThreadFrameMaker(FrameMaker):
    """Runs one thread for each frame in flight.

    Each thread renders in turn and then encodes its own image, so that a frame under load wakes no other thread. Work
    is chosen as late as possible, by a thread that can start it at once.
    """

    def __init__(
        self, rasterizer: Rasterizer, queue: WorkQueue, clock: Callable[[], float], encoder: EncoderStage
    ) -> None:
        self._rasterizer = rasterizer
        self._queue = queue
        self._clock = clock
        self._encoder = encoder
        self._threads = ThreadPoolExecutor(rasterizer.frames_in_flight, "render")
        self._running: list[asyncio.Future[None]] = []

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._threads, self._rasterizer.warm_up)
        for _ in range(self._rasterizer.frames_in_flight):
            self._running.append(loop.run_in_executor(self._threads, self._run))

    async def stop(self) -> None:
        await asyncio.gather(*self._running)
        self._threads.shutdown()

    def _run(self) -> None:
        while self._make_next():  # keeps no reference while it waits, so that an unloaded scene is freed at once
            pass

    def _make_next(self) -> bool:
        """Wait for work and make its frame; False once the queue is closed."""
        work = self._queue.next()
        if work is None:
            return False
        image = self._render(work, is_interruptible=True)
        self._queue.rendered()
        if image is not None:
            self._encoder.finish(work, image)
        return True

    def _render(self, work: Work, *, is_interruptible: bool) -> Image | None:
        """The image, with the time spent on it minus interruptions; None if rendering failed."""
        interrupted = 0.0

        def pause() -> None:
            nonlocal interrupted
            begun = self._clock()
            self._make_ahead_of(work)
            interrupted += self._clock() - begun

        request = work.request
        try:
            started = self._clock()
            image = self._rasterizer.render(
                work.scene.prepared,
                work.size.camera(request, work.scene.background),
                picture_format(request),
                pause if is_interruptible else None,
                depth=has_depth(request),
            )
        except Exception as error:
            self._encoder.failed("Rendering", work, error)
            return None
        image.rendering = self._clock() - started - interrupted
        return image

    def _make_ahead_of(self, work: Work) -> None:
        """Make much smaller frames of other clients before a frame in progress continues."""
        while (urgent := self._queue.next_ahead_of(work)) is not None:
            image = self._render(urgent, is_interruptible=False)
            if image is not None:
                self._encoder.finish(urgent, image)
