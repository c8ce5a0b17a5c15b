"""The engine: takes requests from any transport and answers them with frames, rendering one while encoding others.

Requests wait in a queue (work_queue.py) until the frame maker can start them (frame_maker.py). Nothing here blocks the
event loop.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol, Self

from tigas_common.errors import DeadlineExceeded, DeviceLost, InvalidRequest, OutOfDeviceMemory, Overloaded, TigasError
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.encode.video_chains import MAX_ENCODERS, VideoChains
from tigas_render.engine.frame_maker import FrameMaker, LaneFrameMaker, ThreadFrameMaker
from tigas_render.engine.frame_size import FrameSize
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.engine.work import CallbackQueue, LoadedScene, SceneUse, Work
from tigas_render.engine.work_queue import STOPPING, WorkQueue
from tigas_render.frame import Cancel, Client, Frame, FrameSource, OnAnswer
from tigas_render.raster.base import Rasterizer
from tigas_render.raster.lanes import LaneRasterizer

logger = logging.getLogger(__name__)

STUCK_S: Final = 120.0
"""Seconds without progress after which a frame counts as stuck; the largest frames take a tenth of it on two cores."""


class Scenes(Protocol):
    """The source of scenes: the registry, or a test double."""

    def use(self, scene_id: str, *, coarse: bool = False) -> SceneUse:
        """A context manager that holds the scene in memory. coarse: accept a coarse version while it loads."""

    def evict(self) -> bool:
        """Unload the least recently used scene that is not in use; False if there is no such scene."""


class Engine(FrameSource):
    """Answers RenderRequests with Frames; an async context manager that owns its threads."""

    def __init__(
        self,
        rasterizer: Rasterizer,
        scenes: Scenes,
        ladder: tuple[Rung, ...],
        metrics: EngineMetrics,
        clock: Callable[[], float],
    ) -> None:
        """ladder: for scenes without their own."""
        self._scenes = scenes
        self._ladder = ladder
        self._metrics = metrics
        self._clock = clock
        self.device_lost: asyncio.Future[DeviceLost] = asyncio.get_running_loop().create_future()
        """Resolves with the reason when the device has failed permanently."""
        self._loading: set[asyncio.Task[None]] = set()
        """Tasks of the requests that are waiting for a scene."""
        self._answers: CallbackQueue[tuple[Work, Frame | Exception]] = CallbackQueue(
            lambda answer: self._deliver(*answer)
        )
        self._queue = WorkQueue(rasterizer.frames_in_flight, ladder, clock, self._post)
        self.videos = VideoChains(MAX_ENCODERS, clock)
        self._thread = threading.get_ident()
        suited = LaneFrameMaker if isinstance(rasterizer, LaneRasterizer) else ThreadFrameMaker
        self._maker: FrameMaker = suited(rasterizer, self._queue, clock, self._finish, self.videos)

    async def __aenter__(self) -> Self:
        await self._maker.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._queue.close()
        await self._maker.stop()
        for task in self._loading:
            task.cancel()
        await asyncio.gather(*self._loading, return_exceptions=True)
        self._answers.deliver()

    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        """Request a frame, as in `FrameSource.request`; `arrived` is a time of the engine's clock.

        The answer may be InvalidRequest for a rung beyond the scene's ladder, UnknownScene, BrokenScene, Superseded,
        DeadlineExceeded, Overloaded, OutOfDeviceMemory if unloading an unused scene does not help, or DeviceLost.
        """
        may_be_coarse = request.coarse and request.detail == "auto" and request.format != "png"
        use = self._scenes.use(request.scene, coarse=may_be_coarse)
        work = Work(client, request, arrived, use, on_answer)
        try:
            scene = work.scene_use.enter_if_loaded()
            if scene is None:
                work.loading = asyncio.create_task(self._load_scene(work))
                self._loading.add(work.loading)
                work.loading.add_done_callback(self._loading.discard)
            else:
                self._enqueue(work, scene)
        except TigasError as error:
            self._post(work, error)
        return partial(self._cancel, work)

    def forget(self, client: Client) -> None:
        self.videos.forget(client)

    def state(self) -> tuple[float, float]:
        """The longest wait in seconds and the renderer's utilisation, as in `WorkQueue.state`."""
        return self._queue.state()

    @property
    def in_flight(self) -> dict[str, int]:
        """Numbers of unanswered requests by stage: waiting for a scene, waiting for their turn, and in progress."""
        return {"loading": len(self._loading), "waiting": len(self._queue), "rendering": self._queue.in_progress}

    def check_progress(self) -> None:
        """Declare the device lost if a frame has been rendering for longer than `STUCK_S`."""
        if self._queue.longest_stall_s() > STUCK_S:
            reason = f"The renderer is stuck: a frame has been rendering for more than {STUCK_S:g} s."
            self.lose_device(DeviceLost(reason))

    def lose_device(self, reason: DeviceLost) -> None:
        """Record that the device has failed permanently: only a new process can use it."""
        if not self.device_lost.done():
            self.device_lost.set_result(reason)

    async def _load_scene(self, work: Work) -> None:
        try:
            scene = await work.scene_use.enter()
            work.loading = None
            self._enqueue(work, scene)
        except asyncio.CancelledError:
            self._answer(work, Overloaded(STOPPING))  # cancelled requests have no recipient
            raise
        except Exception as error:
            self._answer(work, error)

    def _enqueue(self, work: Work, scene: LoadedScene) -> None:
        """Queue work whose scene is loaded and in use. Raises InvalidRequest and Overloaded."""
        request = work.request
        work.scene, work.holds_scene = scene, True
        work.ladder = ladder = scene.ladder or self._ladder
        if request.profile is not None and request.profile >= len(ladder):
            raise InvalidRequest(f"profile: the ladder has rungs 0 to {len(ladder) - 1}.")
        work.size = FrameSize.of_request(request, ladder)
        self._queue.push(work)

    def _cancel(self, work: Work) -> None:
        if work.is_over:
            return
        work.on_answer = None
        self._metrics.count_failure("cancelled")
        if work.loading is not None:
            work.loading.cancel()
        if work.holds_scene:
            self._queue.remove(work)
            work.scene_use.leave()

    def _finish(self, work: Work, result: Frame | Exception) -> None:
        """Answer work that has begun: immediately on the event loop, or soon when called from another thread."""
        if threading.get_ident() == self._thread:
            self._deliver(work, result)
        else:
            self._post(work, result)

    def _post(self, work: Work, result: Frame | Exception) -> None:
        self._answers.put((work, result))

    def _deliver(self, work: Work, result: Frame | Exception) -> None:
        """Answer on the event loop: with an error if the deadline has passed, and not yet if a retry is worthwhile."""
        if isinstance(result, Frame):
            try:
                work.check_deadline(self._clock())
            except DeadlineExceeded as error:
                self._handle_undelivered(work, result)
                result = error
        elif isinstance(result, OutOfDeviceMemory) and self._can_retry(work):
            # later, once the error has been released, because it references the failed attempt's allocations
            asyncio.get_running_loop().call_soon(self._retry, work)
            return
        self._answer(work, result)

    def _can_retry(self, work: Work) -> bool:
        return work.holds_scene and not work.is_over and not work.is_retry and self._scenes.evict()

    def _retry(self, work: Work) -> None:
        if work.is_over:
            return
        work.is_retry = True
        try:
            self._queue.push(work)
        except Overloaded as error:
            self._answer(work, error)

    def _answer(self, work: Work, result: Frame | Exception) -> None:
        if isinstance(result, DeviceLost):
            self.lose_device(result)
        on_answer, work.on_answer = work.on_answer, None
        if on_answer is None:
            self._handle_undelivered(work, result)
            return
        if work.holds_scene:
            work.scene_use.leave()
        if isinstance(result, Frame):
            self._metrics.count_frame(work.request.scene, work.client.transport, result)
        elif isinstance(result, TigasError):
            self._metrics.count_failure(result.type)
        try:
            on_answer(result)
        except Exception:  # one viewer's failure must not affect the others
            logger.exception("An answer was not delivered")
            if isinstance(result, Frame):
                result.release()

    def _handle_undelivered(self, work: Work, result: Frame | Exception) -> None:
        if isinstance(result, Frame) and result.video is not None:
            self.videos.mark_lost(work.client, result.seq)
