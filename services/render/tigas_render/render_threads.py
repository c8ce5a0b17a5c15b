"""The threads that make frames: one renders at a time, while the others encode what they have rendered."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from tigas_render.finisher import Finisher, has_depth, picture_format
from tigas_render.raster.base import Image, Rasterizer
from tigas_render.work import Work
from tigas_render.work_queue import WorkQueue


class RenderThreads:
    """As many threads as the rasteriser can have frames in flight.

    Each takes a turn to render, and then encodes its own image: where there is much to do, a frame wakes no thread on
    its way. What is rendered is chosen as late as possible, by a thread that can begin at once.
    """

    def __init__(
        self, rasterizer: Rasterizer, queue: WorkQueue, clock: Callable[[], float], finisher: Finisher
    ) -> None:
        self._rasterizer = rasterizer
        self._queue = queue
        self._clock = clock
        self._finisher = finisher
        self._threads = ThreadPoolExecutor(rasterizer.frames_in_flight, "render")
        self._running: list[asyncio.Future[None]] = []

    async def start(self) -> None:
        """Warm the rasteriser up, and render from now on."""
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._threads, self._rasterizer.warm_up)
        for _ in range(self._rasterizer.frames_in_flight):
            self._running.append(loop.run_in_executor(self._threads, self._run))

    async def stop(self) -> None:
        """Wait until what was begun is finished, once the queue is closed."""
        await asyncio.gather(*self._running)
        self._threads.shutdown()

    # The loop holds nothing while it waits: a scene that was unloaded gives its memory back at once.

    def _run(self) -> None:
        while self.make_next():
            pass

    def make_next(self) -> bool:
        """Wait for work and make its frame; False once the queue is closed."""
        work = self._queue.next()
        if work is None:
            return False
        rendered = self._render(work, is_interruptible=True)
        self._queue.rendered()
        if rendered is not None:
            self._finisher.finish(work, *rendered)
        return True

    def _render(self, work: Work, *, is_interruptible: bool) -> tuple[Image, float] | None:
        """The image, and the seconds that it took, without what interrupted it; None if there is none."""
        interrupted = 0.0

        def pause() -> None:
            nonlocal interrupted
            begun = self._clock()
            self._make_ahead_of(work)
            interrupted += self._clock() - begun

        request = work.request
        try:
            started = self._clock()
            camera = work.size.camera(request, work.scene.background)
            image = self._rasterizer.render(
                work.scene.prepared,
                camera,
                picture_format(request),
                pause if is_interruptible else None,
                depth=has_depth(request),
            )
            return image, self._clock() - started - interrupted
        except Exception as error:
            self._finisher.failed("Rendering", work, error)
            return None

    def _make_ahead_of(self, work: Work) -> None:
        """Make what others wait for that is much smaller, before a frame that has begun goes on."""
        while (urgent := self._queue.next_ahead_of(work)) is not None:
            rendered = self._render(urgent, is_interruptible=False)
            if rendered is not None:
                self._finisher.finish(urgent, *rendered)
