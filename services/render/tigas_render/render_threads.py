"""The threads that make frames: one renders at a time, while the others encode what they have rendered."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from tigas_common.errors import DeadlineExceeded, Superseded, TigasError
from tigas_common.wire.render import FrameFormat, RenderRequest, ServerTiming
from tigas_render.encode.depth_segment import with_depth
from tigas_render.encode.video_chains import VideoChains
from tigas_render.encode.webp import encode_webp
from tigas_render.frame import Frame
from tigas_render.raster.base import Image, Rasterizer
from tigas_render.raster.host_image import HostImage
from tigas_render.raster.stamp import draw_stamp
from tigas_render.work import Work
from tigas_render.work_queue import WorkQueue

logger = logging.getLogger(__name__)


class RenderThreads:
    """As many threads as the rasteriser can have frames in flight.

    Each takes a turn to render, and then encodes its own image: where there is much to do, a frame wakes no thread on
    its way. What is rendered is chosen as late as possible, by a thread that can begin at once.
    """

    def __init__(
        self,
        rasterizer: Rasterizer,
        queue: WorkQueue,
        clock: Callable[[], float],
        answer: Callable[[Work, Frame | Exception], None],
        videos: VideoChains,
    ) -> None:
        """answer: hears what became of work, on any thread."""
        self._rasterizer = rasterizer
        self._videos = videos
        self._queue = queue
        self._clock = clock
        self._answer = answer
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
        while self._make_next():
            pass

    def _make_next(self) -> bool:
        """Wait for work and make its frame; False once the queue is closed."""
        work = self._queue.next()
        if work is None:
            return False
        rendered = self._render(work, is_interruptible=True)
        self._queue.rendered()
        if rendered is not None:
            self._encode(work, *rendered)
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
            format = _picture(request) if request.stamp is None else "png"  # stamped on the host
            camera = work.size.camera(request, work.scene.background)
            image = self._rasterizer.render(
                work.scene.prepared, camera, format, pause if is_interruptible else None, depth=_has_depth(request)
            )
            return image, self._clock() - started - interrupted
        except Exception as error:
            self._failed("Rendering", work, error)
            return None

    def _make_ahead_of(self, work: Work) -> None:
        """Make what others wait for that is much smaller, before a frame that has begun goes on."""
        while (urgent := self._queue.next_ahead_of(work)) is not None:
            rendered = self._render(urgent, is_interruptible=False)
            if rendered is not None:
                self._encode(urgent, *rendered)

    def _encode(self, work: Work, image: Image, rendering: float) -> None:
        request, size = work.request, work.size
        body, video = None, None
        try:
            with image:
                begun = self._clock()
                late = _lateness(work, begun)
                if not work.is_over and late is None:
                    body = _encoded(_stamped(image, work), request, work.ladder[request.profile or 0].quality)
                    if image.depth is not None:
                        body = with_depth(body, image.depth)
            if body is not None and request.video is not None:
                body, video = self._videos.encode(
                    work.client, request.seq, request.video, size.width, size.height, body
                )
            encoding = self._clock() - begun
        except Superseded as error:
            self._queue.done(work)
            self._answer(work, error)
            return
        except Exception as error:
            self._failed("Encoding", work, error)
            return
        self._queue.done(work, rendering + encoding, is_whole=body is not None)
        if late is not None:
            self._answer(work, late)
        if body is None:
            return
        waiting = begun - work.arrived - rendering
        timing = ServerTiming.trusted({"queue": _ms(waiting), "render": _ms(rendering), "encode": _ms(encoding)})
        frame = Frame(
            body, request.format, size.width, size.height, request.seq, request.profile, timing,
            size.margin_x, size.margin_y, video,
        )  # fmt: skip
        self._answer(work, frame)

    def _failed(self, doing: str, work: Work, error: Exception) -> None:
        self._queue.done(work)
        if isinstance(error, TigasError):
            logger.error("%s %s failed: %s", doing, work.request.scene, error.detail)
        else:
            logger.exception("%s %s failed", doing, work.request.scene)
        self._answer(work, error)


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)


def _lateness(work: Work, now: float) -> DeadlineExceeded | None:
    """Why a frame is not worth encoding, if it is too late already."""
    try:
        work.check_deadline(now)
    except DeadlineExceeded as error:
        return error
    return None


def _picture(request: RenderRequest) -> FrameFormat:
    """What an image is taken from the rasteriser as."""
    match request.format:
        case "h264":
            return "yuv420p"
        case "webp":
            return "png"  # whose pixels are the host's
        case format:
            return format


def _encoded(image: Image, request: RenderRequest, quality: int) -> bytes:
    """The picture's file; rasterisers know nothing of WebP."""
    if request.format == "webp":
        return encode_webp(image.to_host(), quality)
    return image.encode(_picture(request), quality)


def _has_depth(request: RenderRequest) -> bool:
    return request.depth and request.format in ("jpeg", "webp")


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
