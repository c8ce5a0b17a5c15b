"""Requests to the render service, and its answers."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import Literal, TypedDict

from PIL import Image

from tigas.errors import Unreachable
from tigas_common.pose import Intrinsics
from tigas_common.wire.render import ServerTiming


class View(TypedDict, total=False):
    """Options for rendering a pose, all optional."""

    scene: str
    """Scene id; optional if the service has only one scene."""
    size: tuple[int, int]
    """Width and height in pixels, with a vertical field of view of 60°; by default 1280 × 720."""
    intrinsics: Intrinsics
    """Intrinsics with their image size, instead of `size`."""
    profile: int
    """Rung of the scene's quality ladder; by default the full size at the best rung's quality."""
    format: Literal["jpeg", "webp", "png"]
    """Encoding; by default JPEG."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A rendered view, undecoded."""

    body: bytes
    """Encoded bytes."""
    content_type: str
    """Media type, such as `image/jpeg`."""
    timing: ServerTiming
    """Server times by stage."""
    protocol: str
    """Transport: `HTTP/3` or `HTTP/1.1`."""

    @property
    def image(self) -> Image.Image:
        """Decode the frame to RGB. Raises Unreachable if it is not an image."""
        try:
            with Image.open(io.BytesIO(self.body)) as picture:
                return picture.convert("RGB")
        except OSError:
            raise Unreachable("The server is not a TIGAS render service: it did not send an image.") from None


def read_timing(header: str) -> ServerTiming:
    """Parse a Server-Timing header; missing values are 0."""
    found = {name: float(ms) for name, ms in re.findall(r"(\w+);dur=(\d+(?:\.\d+)?)", header)}
    return ServerTiming(**{name: found.get(name, 0.0) for name in ("queue", "render", "encode")})
