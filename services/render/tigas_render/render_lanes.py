"""Makes frames on a device from the event loop: lanes of native threads draw and encode them (raster/lanes.py).

What is left to be done on the host, such as video, is done by threads; a JPEG needs none.
"""

from __future__ import annotations

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from tigas_render.finisher import Finisher, has_depth, picture_format
from tigas_render.mailbox import Mailbox
from tigas_render.raster.lanes import FetchedImage, LaneRasterizer, Lanes
from tigas_render.work import Work
from tigas_render.work_queue import WorkQueue


class RenderLanes:
    """Begins a frame whenever a lane is free, and answers when it is done, all on the event loop's thread."""

    def __init__(
        self, rasterizer: LaneRasterizer, queue: WorkQueue, finisher: Finisher, finisher_on_threads: Finisher
    ) -> None:
        """finisher: for the event loop; finisher_on_threads: for any thread."""
        self._rasterizer = rasterizer
        self._queue = queue
        self._finisher = finisher
        self._finisher_on_threads = finisher_on_threads
        self._loop = asyncio.get_running_loop()
        threads = max(rasterizer.lanes, os.cpu_count() or 1)
        self._threads = ThreadPoolExecutor(threads, "host")
        self._on_host = 0
        """Images that threads have, or wait for one."""
        self._most_on_host = threads
        self._left_host: Mailbox[None] = Mailbox(self._leave_host)
        self._lanes: Lanes | None = None

    async def start(self) -> None:
        """Warm the rasteriser up, and render from now on."""
        await self._loop.run_in_executor(self._threads, self._rasterizer.warm_up)
        self._lanes = Lanes(self._rasterizer.lanes, self._rasterizer.enter_thread)
        self._loop.add_reader(self._lanes.fileno(), self._collect)
        self._queue.on_work(partial(self._loop.call_soon, self._begin_all))
        self._begin_all()  # what came before, or the queue learns that there is nothing to do

    async def stop(self) -> None:
        """Wait until what was begun is finished, once the queue is closed."""
        if self._lanes is not None:
            lanes, self._lanes = self._lanes, None
            self._loop.remove_reader(lanes.fileno())
            await self._loop.run_in_executor(self._threads, lanes.end)
            lanes.collect()
            lanes.close()
        await self._loop.run_in_executor(None, self._threads.shutdown)

    def _begin_all(self) -> None:
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
            lanes.begin(job, partial(self._drawn, work))
        except Exception as error:
            self._finisher.failed("Rendering", work, error)

    def _collect(self) -> None:
        if self._lanes is not None:
            self._lanes.collect()
        self._begin_all()

    def _drawn(self, work: Work, image: FetchedImage | Exception) -> None:
        if isinstance(image, Exception):
            self._finisher.failed("Rendering", work, image)
        elif image.format == "jpeg":
            self._finisher.finish(work, image, image.rendering, image.encoding)
        else:
            self._on_host += 1
            self._threads.submit(self._finish_on_host, work, image)

    def _finish_on_host(self, work: Work, image: FetchedImage) -> None:
        try:
            self._finisher_on_threads.finish(work, image, image.rendering, image.encoding)
        finally:
            self._left_host.put(None)

    def _leave_host(self, _: None) -> None:
        self._on_host -= 1
        self._begin_all()
