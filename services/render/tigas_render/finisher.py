"""From an image to the answer: what is encoded on the host, and what the engine is told."""

from __future__ import annotations

import logging
from collections.abc import Callable

from tigas_common.errors import DeadlineExceeded, Superseded, TigasError
from tigas_common.wire.render import FrameFormat, RenderRequest, ServerTiming
from tigas_render.encode.depth_segment import coded, with_depth
from tigas_render.encode.video_chains import VideoChains
from tigas_render.encode.webp import encode_webp
from tigas_render.frame import Frame
from tigas_render.raster.base import Image
from tigas_render.raster.host_image import HostImage
from tigas_render.raster.stamp import draw_stamp
from tigas_render.work import Work
from tigas_render.work_queue import WorkQueue

logger = logging.getLogger(__name__)


class Finisher:
    """Ends work that has begun, with a frame or without. Safe on any thread if `answer` is."""

    def __init__(
        self,
        queue: WorkQueue,
        clock: Callable[[], float],
        answer: Callable[[Work, Frame | Exception], None],
        videos: VideoChains,
    ) -> None:
        """answer: hears what became of work."""
        self._queue = queue
        self._clock = clock
        self._answer = answer
        self._videos = videos

    def finish(self, work: Work, image: Image, rendering: float, encoded: float = 0.0) -> None:
        """Encode the image, and answer. rendering, encoded: seconds that it has taken so far."""
        request, size = work.request, work.size
        body, video = None, None
        try:
            with image:
                begun = self._clock()
                late = _lateness(work, begun)
                if not work.is_over and late is None:
                    body = _encoded(_stamped(image, work), request, work.ladder[request.profile or 0].quality)
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
        """Work that has begun came to nothing."""
        self._queue.done(work)
        if isinstance(error, TigasError):
            logger.error("%s %s failed: %s", doing, work.request.scene, error.detail)
        else:
            logger.error("%s %s failed", doing, work.request.scene, exc_info=error)
        self._answer(work, error)


def picture_format(request: RenderRequest) -> FrameFormat:
    """What an image is to be taken from the rasteriser as."""
    if request.stamp is not None:
        return "png"  # stamped on the host
    return _format(request)


def has_depth(request: RenderRequest) -> bool:
    """Whether the frame is to carry a depth."""
    return request.depth and request.format in ("jpeg", "webp")


def _format(request: RenderRequest) -> FrameFormat:
    match request.format:
        case "h264":
            return "yuv420p"
        case "webp":
            return "png"  # whose pixels are the host's
        case format:
            return format


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)


def _lateness(work: Work, now: float) -> DeadlineExceeded | None:
    """Why a frame is not worth encoding, if it is too late already."""
    try:
        work.check_deadline(now)
    except DeadlineExceeded as error:
        return error
    return None


def _encoded(image: Image, request: RenderRequest, quality: int) -> bytes:
    """The picture's file; rasterisers know nothing of WebP."""
    if request.format == "webp":
        return encode_webp(image.to_host(), quality)
    return image.encode(_format(request), quality)


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
