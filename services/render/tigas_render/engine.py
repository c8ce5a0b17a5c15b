"""The engine: takes requests from any transport and answers with frames, rendering one while others are encoded.

Requests wait on the event loop. One thread renders; as many encode as the rasteriser can have images in flight beside
the one that is rendered. Nothing here blocks the loop.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
from collections import Counter
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Protocol, Self

from tigas_common.errors import (
    DeadlineExceeded,
    DeviceLost,
    InvalidRequest,
    OutOfDeviceMemory,
    Overloaded,
    Superseded,
    TigasError,
)
from tigas_common.wire.render import RenderRequest, Rung, ServerTiming
from tigas_render.admission import Admission
from tigas_render.costs import FrameCosts
from tigas_render.encode.depth_segment import with_depth
from tigas_render.encode_queue import EncodeQueue
from tigas_render.frame import Answered, Client, Frame, FrameSource, Withdraw
from tigas_render.frame_size import FrameSize
from tigas_render.mailbox import Mailbox
from tigas_render.metrics import EngineMetrics
from tigas_render.raster.base import Image, Rasterizer
from tigas_render.raster.host_image import HostImage
from tigas_render.raster.stamp import draw_stamp
from tigas_render.schedule import FairSchedule
from tigas_render.utilisation import Utilisation
from tigas_render.work import LoadedScene, Rendered, SceneUse, Work

logger = logging.getLogger(__name__)

QUEUE_DEPTH = 4
"""Requests of one session that may wait: enough to cover a burst, too few to build up delay."""
MAX_WAITING = 512
"""Requests of all clients together that may wait."""
MIN_COST_S = 0.0001
"""What a turn is charged at least, in seconds: so that those take turns whose frames' cost is not known yet."""

INTERRUPTED_FOR = 4
"""A frame is interrupted for one of another address that is expected to cost so many times less."""

STOPPING = "The server is stopping."


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
    ) -> None:
        """ladder: for scenes without one of their own; waiting_per_address: how many requests of one may wait."""
        self._rasterizer = rasterizer
        self._scenes = scenes
        self._ladder = ladder
        self._metrics = metrics
        self._clock = clock
        self._waiting_per_address = waiting_per_address
        self.device_lost: asyncio.Future[DeviceLost] = asyncio.get_running_loop().create_future()
        """Why nothing can be rendered any more, once that is so."""
        self._schedule: FairSchedule[Work] = FairSchedule(QUEUE_DEPTH)
        self._changed = threading.Condition()
        self._closed = False
        self._images = threading.Semaphore(rasterizer.frames_in_flight)
        self._held: Counter[str] = Counter()
        """Images by address."""
        self._renderer = ThreadPoolExecutor(1, "render")
        self._encoders = ThreadPoolExecutor(rasterizer.frames_in_flight - 1, "encode")
        self._rendered: EncodeQueue[Rendered] = EncodeQueue(rasterizer.frames_in_flight - 1)
        self._costs = FrameCosts()
        self._utilisation = Utilisation(clock())
        self._admission = Admission(ladder, self._costs)
        self._loading: set[asyncio.Task[None]] = set()
        """Those that wait for a scene."""
        self._answers: Mailbox[tuple[Work, Frame | Exception]] = Mailbox(self._deliver)

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(self._renderer, self._rasterizer.warm_up)
        self._running = [loop.run_in_executor(self._renderer, self._render_forever)]
        for _ in range(self._rasterizer.frames_in_flight - 1):
            self._running.append(loop.run_in_executor(self._encoders, self._encode_forever))
        return self

    async def __aexit__(self, *_: object) -> None:
        with self._changed:
            self._closed = True
            while (work := self._schedule.pop()) is not None:
                self._answers.put((work, Overloaded(STOPPING)))
            self._changed.notify()
        await asyncio.gather(*self._running)
        self._encoders.shutdown()
        self._renderer.shutdown()
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
            self._answers.put((work, error))
        return partial(self._withdraw, work)

    def state(self) -> tuple[float, float]:
        """How long the client has waited, in seconds, that has waited longest for its next frame to begin; and the
        share of the time since the last call, 0 to 1, in which the rasteriser had something to do.
        """
        with self._changed:
            now = self._clock()
            oldest = min((work.arrived for work in self._schedule.newest()), default=now)
            return max(0.0, now - oldest), self._utilisation.share(now)

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
        self._enqueue(work)

    def _enqueue(self, work: Work) -> None:
        client, request = work.client, work.request
        with self._changed:
            if self._closed or len(self._schedule) >= MAX_WAITING:
                raise Overloaded(STOPPING if self._closed else "Too many requests wait; ask less often.")
            if self._schedule.waiting(client.address) >= self._waiting_per_address:
                raise Overloaded("Too many requests from this address wait; ask less often.")
            self._admission.heard_of(client, self._clock())
            work.expected = max(MIN_COST_S, self._costs.at_least(request.scene, request.format, work.size.pixels))
            pushed_out = self._schedule.push(client, work, work.expected)
            self._changed.notify()
        if pushed_out is not None:
            self._answers.put((pushed_out, Superseded("Newer requests of this client took this one's place.")))

    def _withdraw(self, work: Work) -> None:
        if work.is_over:
            return
        work.answered = None
        self._metrics.count("cancelled")
        if work.loading is not None:
            work.loading.cancel()
        if work.is_entered:
            with self._changed:
                self._schedule.remove(work.client, work)
            work.use.leave()

    def _deliver(self, answer: tuple[Work, Frame | Exception]) -> None:
        """What became of some work, on the event loop."""
        work, result = answer
        if isinstance(result, Frame):
            try:
                work.check_deadline(self._clock())
            except DeadlineExceeded as error:
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
            self._enqueue(work)
        except Overloaded as error:
            self._answer(work, error)

    def _answer(self, work: Work, result: Frame | Exception) -> None:
        if isinstance(result, DeviceLost):
            self.lose_device(result)
        answered, work.answered = work.answered, None
        if answered is None:
            return
        if work.is_entered:
            work.use.leave()
        if isinstance(result, Frame):
            self._metrics.frame(result)
        elif isinstance(result, TigasError):
            self._metrics.count(result.type)
        answered(result)

    # The threads' loops hold nothing while they wait: a scene that was unloaded gives its memory back at once.

    def _render_forever(self) -> None:
        while self._render_next():
            pass
        self._rendered.close()

    def _render_next(self) -> bool:
        """Wait for work and render it; False once the engine is closed."""
        # The image's place is taken first, so that the choice of what to render is made as late as possible.
        self._images.acquire()
        work = self._next()
        if work is None:
            return False
        self._render(work)
        return True

    def _render(self, work: Work, *, interruptible: bool = True) -> None:
        interrupted = 0.0

        def pause() -> None:
            nonlocal interrupted
            begun = self._clock()
            self._render_ahead_of(work)
            interrupted += self._clock() - begun

        try:
            started = self._clock()
            format = work.request.format if work.request.stamp is None else "png"  # stamped on the host
            camera = work.size.camera(work.request, work.scene.background)
            image = self._rasterizer.render(
                work.scene.prepared, camera, format, pause if interruptible else None, depth=_has_depth(work.request)
            )
            rendering = self._clock() - started - interrupted
        except Exception as error:
            self._release(work)
            self._failed("Rendering", work, error)
        else:
            self._rendered.put(work.client.address, Rendered(work, image, rendering))

    def _render_ahead_of(self, work: Work) -> None:
        """Render what others wait for that is much smaller, before a frame that has begun goes on."""
        while self._images.acquire(blocking=False):
            with self._changed:
                urgent = self._pop({work.client.address}, work.expected / INTERRUPTED_FOR)
            if urgent is None:
                self._images.release()
                return
            self._render(urgent, interruptible=False)

    def _encode_forever(self) -> None:
        while self._encode_next():
            pass

    def _encode_next(self) -> bool:
        """Wait for an image and encode it; False once the engine is closed."""
        taken = self._rendered.take()
        if taken is None:
            return False
        address, rendered = taken
        try:
            self._encode(rendered)
        finally:
            self._rendered.done(address)
        return True

    def _release(self, work: Work) -> None:
        """An image's place is free again."""
        with self._changed:
            self._held[work.client.address] -= 1
            if not self._held[work.client.address]:
                del self._held[work.client.address]
            if self._schedule:
                self._changed.notify()
        self._images.release()

    def _failed(self, doing: str, work: Work, error: Exception) -> None:
        if isinstance(error, TigasError):
            logger.error("%s %s failed: %s", doing, work.request.scene, error.detail)
        else:
            logger.exception("%s %s failed", doing, work.request.scene)
        self._answers.put((work, error))

    def _next(self) -> Work | None:
        """Wait for work that can be rendered; None once the engine is closed."""
        with self._changed:
            work = self._pop()
            if work is None:
                self._utilisation.rest(self._clock())
                while work is None and not self._closed:
                    self._changed.wait()
                    work = self._pop()
                self._utilisation.work(self._clock())
            return work

    def _pop(self, besides: Collection[str] = (), at_most: float = math.inf) -> Work | None:
        """The next work that can be rendered now, at its client's charge; None if there is none.

        Not of the addresses `besides`, nor of one that has all images but the last, and at most so costly.
        """
        most = max(2, self._rasterizer.frames_in_flight - 1)
        left_out = {*besides, *(address for address, images in self._held.items() if images >= most)}
        while (work := self._schedule.pop(left_out, at_most)) is not None:
            if work.is_over:
                continue
            try:
                self._check(work)
            except (DeadlineExceeded, Overloaded) as error:
                self._answers.put((work, error))
                continue
            self._schedule.begin(work.client, work.expected)
            for older in self._schedule.remove_if(work.client, work.overtakes):
                self._answers.put((older, Superseded("A newer view of this client is rendered instead.")))
            self._held[work.client.address] += 1
            return work
        return None

    def _check(self, work: Work) -> None:
        """Raises DeadlineExceeded and Overloaded if a frame is not to be rendered now."""
        request, now = work.request, self._clock()
        try:
            work.check_deadline(now + self._costs.at_least(request.scene, request.format, work.size.pixels))
        except DeadlineExceeded:
            self._costs.doubt(request.scene, request.format)
            raise
        self._admission.check(work.client, request, work.size, now, others_wait=self._schedule.others_wait(work.client))
        self._admission.heard_of(work.client, now)

    def _encode(self, rendered: Rendered) -> None:
        work, image, request, size = rendered.work, rendered.image, rendered.work.request, rendered.work.size
        rendering = rendered.rendering
        try:
            with image:
                if work.is_over:
                    self._settle(work, rendering)
                    return
                quality = work.ladder[request.profile or 0].quality
                begun = self._clock()
                body = _stamped(image, work).encode(request.format, quality)
                if image.depth is not None:
                    body = with_depth(body, image.depth)
                encoding = self._clock() - begun
        except Exception as error:
            self._failed("Encoding", work, error)
            return
        finally:
            self._release(work)
        self._settle(work, rendering + encoding)
        with self._changed:
            self._costs.measured(request.scene, request.format, size.pixels, rendering + encoding)
        waiting = begun - work.arrived - rendering
        timing = ServerTiming(
            queue=round(1000 * waiting, 3), render=round(1000 * rendering, 3), encode=round(1000 * encoding, 3)
        )
        frame = Frame(
            body, request.format, size.width, size.height, request.seq, request.profile, timing,
            size.margin_x, size.margin_y,
        )  # fmt: skip
        self._answers.put((work, frame))

    def _settle(self, work: Work, seconds: float) -> None:
        """Charge the client for what its frame has really cost."""
        with self._changed:
            self._schedule.settle(work.client, max(seconds, MIN_COST_S) - work.expected)


def _has_depth(request: RenderRequest) -> bool:
    return request.depth and request.format == "jpeg"


def _stamped(image: Image, work: Work) -> Image:
    """The image, or a copy in the host's memory with the number that was asked for drawn into what shows the viewport.

    So the stamp is at the upper left of what is seen, with or without overscan.
    """
    stamp, size = work.request.stamp, work.size
    if stamp is None:
        return image
    pixels = image.to_host()
    rows, columns = slice(size.margin_y, size.height - size.margin_y), slice(size.margin_x, size.width - size.margin_x)
    draw_stamp(pixels[rows, columns], stamp)
    return HostImage(pixels)
