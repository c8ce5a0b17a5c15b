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
"""The transport of a viewer; `none` if the service requests an image itself."""


class Client(NamedTuple):
    """One viewer, as far as it can be identified. The engine is fair between addresses, and between the sessions of an
    address.
    """

    address: str
    """IPv4 address, or the /64 of an IPv6 address."""
    session: str
    """A name that is unique for the address. Parallel connections of a viewer are `VIEWER/CONNECTION`."""
    transport: Transport = "none"

    @property
    def viewer(self) -> tuple[str, str]:
        """The address, and the part of the session's name that all connections of the viewer share."""
        return self.address, self.session.rpartition("/")[0] or self.session


def supersedes(request: RenderRequest, other: RenderRequest) -> bool:
    """Whether a request makes the frame of another useless to their session: the same view at an earlier time.

    Requests without numbers, and additional images with other lenses or no rung, do not supersede the frames of a view.
    """
    return other.seq < request.seq and _view_key(other) == _view_key(request)


def _view_key(request: RenderRequest) -> tuple[object, ...]:
    lens = (request.width, request.height, request.fx, request.fy, request.cx, request.cy)
    return request.scene, request.format, request.profile is None, lens


@dataclass(slots=True)
class Frame:
    """The answer to one RenderRequest."""

    body: bytes | memoryview
    """The encoded frame. A memoryview must not be read after `release`, or once the frame is dropped."""
    format: AnswerFormat
    width: int
    """Width in pixels, including margins."""
    height: int
    """Height in pixels, including margins."""
    seq: int
    profile: int | None
    timing: ServerTiming
    margin_x: int = 0
    """Pixels beyond the viewport on each side, left and right."""
    margin_y: int = 0
    """Pixels beyond the viewport on each side, top and bottom."""
    video: VideoInfo | None = None
    """The frame's place in the session's video, if any."""
    coarse: bool = False
    """Whether it shows a coarse scene, because the scene is still loading."""
    on_release: Callable[[], None] | None = None
    """Releases the body's memory."""

    def release(self) -> None:
        """Release the body's memory, after which it must not be read. Dropping a frame does the same."""
        on_release, self.on_release = self.on_release, None
        if on_release is not None:
            on_release()

    __del__ = release

    @property
    def content_type(self) -> str:
        return CONTENT_TYPES[self.format]


OnAnswer = Callable[[Frame | Exception], None]
Cancel = Callable[[], None]


class FrameSource(ABC):
    """A source of frames, such as the engine. It belongs to one event loop."""

    @abstractmethod
    def request(self, client: Client, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        """Request a frame. arrived: when the request was received, on the monotonic clock.

        on_answer: called once, on the event loop and after this has returned, with the frame or an error, usually a
        TigasError such as UnknownScene, BrokenScene, Superseded, DeadlineExceeded or Overloaded. Returns a function
        that cancels the request, after which `on_answer` is not called. Calling it again has no effect.
        """

    def forget(self, client: Client) -> None:  # noqa: B027 - most sources keep nothing
        """Drop the state of a client that has left or missed a frame of its video, so that it gets a key frame next."""

    async def submit(self, client: Client, request: RenderRequest, arrived: float) -> Frame:
        """Request a frame and wait for it. Raises the request's error. Cancelling the call cancels the request."""
        answer: asyncio.Future[Frame] = asyncio.get_running_loop().create_future()
        cancel = self.request(client, request, arrived, partial(_resolve, answer))
        try:
            return await answer
        except asyncio.CancelledError:
            cancel()
            if answer.done() and not answer.cancelled() and answer.exception() is None:
                answer.result().release()  # the frame arrived at the moment of cancellation
            raise


def _resolve(future: asyncio.Future[Frame], answer: Frame | Exception) -> None:
    if future.done():
        return
    if isinstance(answer, Frame):
        future.set_result(answer)
    else:
        future.set_exception(answer)
