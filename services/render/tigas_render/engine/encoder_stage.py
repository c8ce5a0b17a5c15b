"""The encoder stage: turns a rendered image into the answer to its request."""

from __future__ import annotations

import logging
from collections.abc import Callable

from tigas_common.errors import DeadlineExceeded, Superseded, TigasError
from tigas_common.wire.render import FrameFormat, RenderRequest, ServerTiming
from tigas_render.encode.depth_segment import coded, with_depth
from tigas_render.encode.images import encode_webp
from tigas_render.encode.video_chains import VideoChains
from tigas_render.engine.work import Work
from tigas_render.engine.work_queue import WorkQueue
from tigas_render.frame import Frame
from tigas_render.raster.base import Image

logger = logging.getLogger(__name__)


class EncoderStage:
    """Completes work that has begun, with a frame or an error. Safe on any thread if `answer` is."""

    def __init__(
        self,
        queue: WorkQueue,
        clock: Callable[[], float],
        answer: Callable[[Work, Frame | Exception], None],
        videos: VideoChains,
    ) -> None:
        """answer: called with the outcome of each work."""
        self._queue = queue
        self._clock = clock
        self._answer = answer
        self._videos = videos

    def finish(self, work: Work, image: Image) -> None:
        """Encode and close the image, and answer."""
        request, size, rendering, encoded = work.request, work.size, image.rendering, image.encoding
        body, video = None, None
        try:
            with image:
                begun = self._clock()
                late = _lateness(work, begun)
                if not work.is_over and late is None:
                    body = _encoded(image, request, work.ladder[request.profile or 0].quality)
                    depth = image.coded_depth
                    if depth is None and image.depth is not None:
                        depth = coded(image.depth)
                    if depth is not None:
                        body = with_depth(body, depth)
            if body is not None and request.video is not None:
                body, video = self._videos.encode(
                    work.client, request.seq, request.video, size.width, size.height, body
                )
            encoding = self._clock() - begun + encoded
        except Superseded as error:
            self._queue.done(work)
            self._answer(work, error)
            return
        except Exception as error:
            self.failed("Encoding", work, error)
            return
        self._queue.done(work, rendering + encoding, is_whole=body is not None)
        if late is not None:
            self._answer(work, late)
        if body is None:
            return
        waiting = begun - work.arrived - rendering - encoded
        timing = ServerTiming.trusted({"queue": _ms(waiting), "render": _ms(rendering), "encode": _ms(encoding)})
        frame = Frame(
            body, request.format, size.width, size.height, request.seq, request.profile, timing,
            size.margin_x, size.margin_y, video,
        )  # fmt: skip
        self._answer(work, frame)

    def failed(self, doing: str, work: Work, error: Exception) -> None:
        """Answer work that has begun with an error. doing: the failed step, for the log."""
        self._queue.done(work)
        if isinstance(error, TigasError):
            logger.error("%s %s failed: %s", doing, work.request.scene, error.detail)
        else:
            logger.error("%s %s failed", doing, work.request.scene, exc_info=error)
        self._answer(work, error)


def has_depth(request: RenderRequest) -> bool:
    """Whether the frame carries depth."""
    return request.depth and request.format in ("jpeg", "webp")


def picture_format(request: RenderRequest) -> FrameFormat:
    """The format to request from the rasteriser."""
    match request.format:
        case "h264":
            return "yuv420p"
        case "webp":
            return "png"  # gives access to the pixels
        case format:
            return format


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)


def _lateness(work: Work, now: float) -> DeadlineExceeded | None:
    """The error of a frame that is too late to be worth encoding; None if it is in time."""
    try:
        work.check_deadline(now)
    except DeadlineExceeded as error:
        return error
    return None


def _encoded(image: Image, request: RenderRequest, quality: int) -> bytes:
    """The image in the requested format; rasterisers do not support WebP."""
    if request.format == "webp":
        return encode_webp(image.to_host(), quality)
    return image.encode(picture_format(request), quality)
