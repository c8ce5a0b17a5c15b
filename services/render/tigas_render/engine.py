"""The engine: takes requests from any transport and answers with frames, rendering one while others are encoded.

Requests wait in a queue (work_queue.py) until a thread that makes frames takes them (render_threads.py), or, where a
device makes them, until one of its lanes is free (render_lanes.py). Nothing here blocks the event loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Protocol, Self

from tigas_common.errors import DeadlineExceeded, DeviceLost, InvalidRequest, OutOfDeviceMemory, Overloaded, TigasError
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.encode.video_chains import VIDEO_ENCODERS, VideoChains
from tigas_render.finisher import Finisher
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.frame_size import FrameSize
from tigas_render.mailbox import Mailbox
from tigas_render.metrics import EngineMetrics
from tigas_render.raster.base import Rasterizer
from tigas_render.raster.lanes import LaneRasterizer
from tigas_render.render_lanes import RenderLanes
from tigas_render.render_threads import RenderThreads
from tigas_render.work import LoadedScene, SceneUse, Work
from tigas_render.work_queue import MAX_WAITING, STOPPING, WorkQueue


class Scenes(Protocol):
    """Where scenes come from: the registry, or a test's stand-in."""

    def use(self, scene_id: str) -> SceneUse:
        """What holds the scene in memory once it is entered."""

    def evict(self) -> bool:
        """Unload the least recently used of the scenes that nobody uses; False if there is none."""


class Engine(FrameSource):
    """Answers RenderRequests with Frames; an async context manager that owns its threads."""

    def __init__(
        self,
        rasterizer: Rasterizer,
        scenes: Scenes,
        ladder: tuple[Rung, ...],
        metrics: EngineMetrics,
        clock: Callable[[], float],
        waiting_per_address: int = MAX_WAITING,
        video_encoders: int = VIDEO_ENCODERS,
    ) -> None:
        """ladder: for scenes without one of their own; waiting_per_address: how many requests of one may wait;
        video_encoders: how many clients' videos are encoded at a time.
        """
        self._scenes = scenes
        self._ladder = ladder
        self._metrics = metrics
        self._clock = clock
        self.device_lost: asyncio.Future[DeviceLost] = asyncio.get_running_loop().create_future()
        """Why nothing can be rendered any more, once that is so."""
        self._loading: set[asyncio.Task[None]] = set()
        """Those that wait for a scene."""
        self._answers: Mailbox[tuple[Work, Frame | Exception]] = Mailbox(lambda answer: self._deliver(*answer))
        self._queue = WorkQueue(rasterizer.frames_in_flight, ladder, clock, self._post, waiting_per_address)
        self.videos = VideoChains(video_encoders, clock)
        on_any_thread = Finisher(self._queue, clock, self._post, self.videos)
        self._makers: RenderThreads | RenderLanes
        if isinstance(rasterizer, LaneRasterizer):
            here = Finisher(self._queue, clock, self._deliver, self.videos)
            self._makers = RenderLanes(rasterizer, self._queue, here, on_any_thread)
        else:
            self._makers = RenderThreads(rasterizer, self._queue, clock, on_any_thread)

    async def __aenter__(self) -> Self:
        await self._makers.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self._queue.close()
        await self._makers.stop()
        for task in self._loading:
            task.cancel()
        await asyncio.gather(*self._loading, return_exceptions=True)
        self._answers.deliver()

    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        """Ask for a frame, as `FrameSource.request`, at a time of the engine's clock.

        Answers InvalidRequest for a rung that the scene's ladder does not have, UnknownScene, BrokenScene, Superseded,
        DeadlineExceeded and Overloaded; OutOfDeviceMemory, if that is so even after unloading a scene that nobody uses;
        and DeviceLost.
        """
        work = Work(client, request, arrived, self._scenes.use(request.scene), answered)
        try:
            scene = work.use.enter_if_loaded()
            if scene is None:
                work.loading = asyncio.create_task(self._enter(work))
                self._loading.add(work.loading)
                work.loading.add_done_callback(self._loading.discard)
            else:
                self._begin(work, scene)
        except TigasError as error:
            self._post(work, error)
        return partial(self._withdraw, work)

    def forget(self, client: Client) -> None:
        """Free the encoder of a client's video."""
        self.videos.forget(client)

    def state(self) -> tuple[float, float]:
        """How busy the renderer is, as `WorkQueue.state`."""
        return self._queue.state()

    @property
    def in_flight(self) -> dict[str, int]:
        """Requests that are not answered: whose scene is loaded, who wait for their turn, and whose picture is made."""
        return {"loading": len(self._loading), "waiting": len(self._queue), "rendering": self._queue.at_work}

    def lose_device(self, reason: DeviceLost) -> None:
        """Remember that the device failed for good: only a new process can use it."""
        if not self.device_lost.done():
            self.device_lost.set_result(reason)

    async def _enter(self, work: Work) -> None:
        """Wait until the scene is loaded."""
        try:
            scene = await work.use.enter()
            work.loading = None
            self._begin(work, scene)
        except asyncio.CancelledError:
            self._answer(work, Overloaded(STOPPING))  # nobody is there any more if it was withdrawn
            raise
        except Exception as error:
            self._answer(work, error)

    def _begin(self, work: Work, scene: LoadedScene) -> None:
        """The scene is entered: queue the work. Raises InvalidRequest and Overloaded."""
        request = work.request
        work.scene, work.is_entered = scene, True
        work.ladder = ladder = scene.ladder or self._ladder
        if request.profile is not None and request.profile >= len(ladder):
            raise InvalidRequest(f"profile: the ladder has rungs 0 to {len(ladder) - 1}.")
        work.size = FrameSize.of(request, ladder)
        self._queue.push(work)

    def _withdraw(self, work: Work) -> None:
        if work.is_over:
            return
        work.answered = None
        self._metrics.count("cancelled")
        if work.loading is not None:
            work.loading.cancel()
        if work.is_entered:
            self._queue.remove(work)
            work.use.leave()

    def _post(self, work: Work, result: Frame | Exception) -> None:
        """What became of some work, on any thread."""
        self._answers.put((work, result))

    def _deliver(self, work: Work, result: Frame | Exception) -> None:
        """What became of some work, on the event loop."""
        if isinstance(result, Frame):
            try:
                work.check_deadline(self._clock())
            except DeadlineExceeded as error:
                self._lost(work, result)
                result = error
        elif isinstance(result, OutOfDeviceMemory) and self._may_try_again(work):
            # not before the error is gone, which holds what was allocated until then
            asyncio.get_running_loop().call_soon(self._try_again, work)
            return
        self._answer(work, result)

    def _may_try_again(self, work: Work) -> bool:
        return work.is_entered and not work.is_over and not work.is_second_try and self._scenes.evict()

    def _try_again(self, work: Work) -> None:
        if work.is_over:
            return
        work.is_second_try = True
        try:
            self._queue.push(work)
        except Overloaded as error:
            self._answer(work, error)

    def _answer(self, work: Work, result: Frame | Exception) -> None:
        if isinstance(result, DeviceLost):
            self.lose_device(result)
        answered, work.answered = work.answered, None
        if answered is None:
            self._lost(work, result)
            return
        if work.is_entered:
            work.use.leave()
        if isinstance(result, Frame):
            self._metrics.frame(work.request.scene, work.client.transport, result)
        elif isinstance(result, TigasError):
            self._metrics.count(result.type)
        answered(result)

    def _lost(self, work: Work, result: Frame | Exception) -> None:
        """Nobody gets what became of some work."""
        if isinstance(result, Frame) and result.video is not None:
            self.videos.lost(work.client, result.seq)
