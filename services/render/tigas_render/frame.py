"""Who asks for frames, a finished frame, and the one thing a transport needs to know of the engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tigas_common.wire.render import FrameFormat, RenderRequest, ServerTiming

CONTENT_TYPES: dict[FrameFormat, str] = {
    "jpeg": "image/jpeg",
    "png": "image/png",
    "yuv420p": "video/x-raw; format=I420",
}


@dataclass(frozen=True, slots=True)
class Client:
    """One viewer, as far as can be told. The engine is fair between addresses, and between an address's sessions."""

    address: str
    """Its IPv4 address, or the /64 of its IPv6 address."""
    session: str
    """A name that no other session of the address has."""


@dataclass(frozen=True, slots=True)
class Frame:
    """The answer to one RenderRequest."""

    body: bytes
    format: FrameFormat
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    seq: int
    profile: int | None
    timing: ServerTiming
    margin_x: int = 0
    """Pixels beyond the viewport at the left, and as many at the right; they count in the width."""
    margin_y: int = 0
    """The same at the top and at the bottom."""

    @property
    def content_type(self) -> str:
        """The body's media type."""
        return CONTENT_TYPES[self.format]


class FrameSource(Protocol):
    """Whatever answers requests with frames: the engine, or a test's stand-in."""

    async def submit(self, client: Client, request: RenderRequest, arrived: float) -> Frame:
        """The frame for a request that arrived at a time of the monotonic clock; cancel the call to withdraw it.

        Raises a TigasError: UnknownScene, BrokenScene, Superseded, DeadlineExceeded, Overloaded.
        """
