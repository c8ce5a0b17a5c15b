"""Clients, finished frames, and the engine's interface to transports."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

from tigas_common.wire.render import AnswerFormat, RenderRequest, ServerTiming, VideoInfo

CONTENT_TYPES: dict[AnswerFormat, str] = {
    "jpeg": "image/jpeg",
    "png": "image/png",
    "yuv420p": "video/x-raw; format=I420",
    "h264": "video/h264",
    "webp": "image/webp",
}

Transport = Literal["webtransport", "http3", "http1", "none"]
"""How a viewer is reached; `none`: the service asks for a picture itself."""


class Client(NamedTuple):
    """One viewer, as far as it can be identified. The engine is fair between addresses, and between an address's
    sessions.
    """

    address: str
    """Its IPv4 address, or the /64 of its IPv6 address."""
    session: str
    """A name that no other session of the address has. Parallel connections of one viewer are `VIEWER/CONNECTION`."""
    transport: Transport = "none"

    @property
    def viewer(self) -> tuple[str, str]:
        """Its address, and what all its connections have in common."""
        return self.address, self.session.rpartition("/")[0] or self.session


def obsoletes(request: RenderRequest, other: RenderRequest) -> bool:
    """Whether a frame is useless to its session once there is another: it shows the same view at an earlier moment.

    Requests without numbers and additional pictures, which have other lenses or no rung, obsolete no frame of a view.
    """
    return other.seq < request.seq and _kind(other) == _kind(request)


def _kind(request: RenderRequest) -> tuple[object, ...]:
    lens = (request.width, request.height, request.fx, request.fy, request.cx, request.cy)
    return request.scene, request.format, request.profile is None, lens


@dataclass(slots=True)
class Frame:
    """The answer to one RenderRequest."""

    body: bytes | memoryview
    """To be read while there is the frame, and until `release` if it is a memoryview."""
    format: AnswerFormat
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
    video: VideoInfo | None = None
    """Its place in the session's video, if it is of one."""
    coarse: bool = False
    """Whether it shows a coarse scene, because the scene is loading."""
    on_release: Callable[[], None] | None = None
    """Releases the memory of the body."""

    def release(self) -> None:
        """Release the body's memory, after which it must not be read. Dropping a frame does the same."""
        on_release, self.on_release = self.on_release, None
        if on_release is not None:
            on_release()

    __del__ = release

    @property
    def content_type(self) -> str:
        return CONTENT_TYPES[self.format]


Answered = Callable[[Frame | Exception], None]
Withdraw = Callable[[], None]


class FrameSource(ABC):
    """Answers requests with frames: the engine, or a fake. It belongs to one event loop."""

    @abstractmethod
    def request(self, client: Client, request: RenderRequest, arrived: float, answered: Answered) -> Withdraw:
        """Request a frame, for a request received at a time of the monotonic clock.

        answered: called once, on the event loop and after this has returned, with the frame or an error: usually a
        TigasError, such as UnknownScene, BrokenScene, Superseded, DeadlineExceeded or Overloaded. Returns a function
        that cancels the request, after which `answered` is not called. Later calls have no effect.
        """

    def forget(self, client: Client) -> None:  # noqa: B027 - most keep nothing
        """Drop the state of a client that has left, or missed a frame of its video: the next one is a key frame."""

    async def submit(self, client: Client, request: RenderRequest, arrived: float) -> Frame:
        """The frame for a request, like `request`; raises its error. Cancelling the call cancels the request."""
        answer: asyncio.Future[Frame] = asyncio.get_running_loop().create_future()
        withdraw = self.request(client, request, arrived, partial(_resolve, answer))
        try:
            return await answer
        except asyncio.CancelledError:
            withdraw()
            if answer.done() and not answer.cancelled() and answer.exception() is None:
                answer.result().release()  # it arrived at the moment of cancellation
            raise


def _resolve(future: asyncio.Future[Frame], answer: Frame | Exception) -> None:
    if future.done():
        return
    if isinstance(answer, Frame):
        future.set_result(answer)
    else:
        future.set_exception(answer)
