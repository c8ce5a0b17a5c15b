"""What is asked of the render service, and its answer."""

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
    """How a pose is to be rendered; all of it may be left out."""

    scene: str
    """Its id; left out: the only one that the service has."""
    size: tuple[int, int]
    """Width and height in pixels of a view that is 60° high; left out: 1280 × 720."""
    intrinsics: Intrinsics
    """Another lens, with its own size."""
    profile: int
    """A rung of the scene's quality ladder; left out: the view's own size, at the best rung's quality."""
    format: Literal["jpeg", "webp", "png"]
    """Left out: JPEG."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A rendered view as it came."""

    body: bytes
    """The file."""
    content_type: str
    """Its type, such as `image/jpeg`."""
    timing: ServerTiming
    """Where the server's time went."""
    protocol: str
    """How it came: `HTTP/3` or `HTTP/1.1`."""

    @property
    def image(self) -> Image.Image:
        """The picture, RGB. Raises Unreachable if there is none in it."""
        try:
            with Image.open(io.BytesIO(self.body)) as picture:
                return picture.convert("RGB")
        except OSError:
            raise Unreachable("What answers is no TIGAS render service: it sent no picture.") from None


def read_timing(header: str) -> ServerTiming:
    """The values of a Server-Timing header; 0 for what it lacks."""
    found = {name: float(ms) for name, ms in re.findall(r"(\w+);dur=(\d+(?:\.\d+)?)", header)}
    return ServerTiming(**{name: found.get(name, 0.0) for name in ("queue", "render", "encode")})
