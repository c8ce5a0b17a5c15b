"""The size of a frame: the pixels of the rung or of the viewport, plus the margins for overscan."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from tigas_common.errors import InvalidRequest
from tigas_common.pose import Intrinsics
from tigas_common.wire.model import MAX_PIXELS, MAX_SIDE
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.raster.base import Camera

MIN_VIDEO_SIDE: Final = 16
MAX_VIDEO_PIXELS: Final = 36_864 * 256
"""Maximum frame size of H.264 level 5.2 (ITU-T H.264, table A-1)."""


@dataclass(frozen=True, slots=True)
class FrameSize:
    """A frame's size in pixels: the viewport's part and the margins around it. Width and height include both."""

    inner_width: int
    inner_height: int
    margin_x: int
    """Columns on each side, left and right."""
    margin_y: int
    """Rows on each side, top and bottom."""
    width: int = field(init=False, compare=False)
    height: int = field(init=False, compare=False)
    pixels: int = field(init=False, compare=False)

    def __post_init__(self) -> None:
        width, height = self.inner_width + 2 * self.margin_x, self.inner_height + 2 * self.margin_y
        for name, value in (("width", width), ("height", height), ("pixels", width * height)):
            object.__setattr__(self, name, value)

    @classmethod
    def of_request(cls, request: RenderRequest, ladder: tuple[Rung, ...]) -> FrameSize:
        """The frame's size for a request with a valid profile. Raises InvalidRequest if it is too large."""
        rung = None if request.profile is None else ladder[request.profile]
        return _frame_size(request.width, request.height, rung, request.overscan, request.video is not None)

    def camera(self, request: RenderRequest, background: tuple[float, float, float]) -> Camera:
        """The request's view. Margins extend it without changing its centre."""
        lens = request.fx, request.fy, request.cx, request.cy, request.width, request.height
        intrinsics, enlarged = _intrinsics(self, *lens)
        scale = max(1.0, request.display_scale * enlarged)
        full_detail = request.detail == "full" or request.format == "png"
        return Camera(request.pose, intrinsics, background, scale, (self.margin_x, self.margin_y), full_detail)


@lru_cache(maxsize=1024)  # a viewer sends thousands of requests with the same lens, or a few
def _intrinsics(
    size: FrameSize, fx: float, fy: float, cx: float, cy: float, width: int, height: int
) -> tuple[Intrinsics, float]:
    """A frame's intrinsics, and the scale from its pixels to the viewport's, equal on both axes up to rounding.

    The other arguments are the viewport's intrinsics.
    """
    of_viewport = Intrinsics(fx, fy, cx, cy, width, height)
    intrinsics = of_viewport.resized(size.inner_width, size.inner_height).with_margins(size.margin_x, size.margin_y)
    return intrinsics, math.sqrt(width * height / (size.inner_width * size.inner_height))


@lru_cache(maxsize=1024)  # for the same reason
def _frame_size(width: int, height: int, rung: Rung | None, overscan: float, is_video: bool) -> FrameSize:
    if rung is not None:
        width, height = rung.size_for(width, height)
    if is_video:  # chroma has half as many pixels on each side
        width, height = max(MIN_VIDEO_SIDE, width - width % 2), max(MIN_VIDEO_SIDE, height - height % 2)
    size = FrameSize(width, height, round(width * overscan), round(height * overscan))
    if overscan and (max(size.width, size.height) > MAX_SIDE or size.pixels > MAX_PIXELS):
        raise InvalidRequest(
            f"overscan: the frame would have {size.width}×{size.height} pixels; at most {MAX_SIDE} on a side and "
            f"{MAX_PIXELS} in all are rendered."
        )
    if is_video and size.pixels > MAX_VIDEO_PIXELS:
        raise InvalidRequest(
            f"video: the frame would have {size.width}×{size.height} pixels; H.264 allows {MAX_VIDEO_PIXELS}."
        )
    return size
