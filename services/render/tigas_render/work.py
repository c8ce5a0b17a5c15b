"""What the engine's threads hand on: a request on its way to a frame, from any thread back to its event loop."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Protocol

from tigas_common.errors import DeadlineExceeded
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.frame import Client, Frame
from tigas_render.frame_size import FrameSize
from tigas_render.raster.base import Image, PreparedScene


class LoadedScene(Protocol):
    """What the engine needs of a scene in use."""

    @property
    def prepared(self) -> PreparedScene:
        """The scene on the rasteriser's device."""

    @property
    def background(self) -> tuple[float, float, float]:
        """RGB, 0 to 1."""

    @property
    def ladder(self) -> tuple[Rung, ...] | None:
        """The scene's own quality levels, the best first, if it has them."""


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """A request that waits for its frame, or is being rendered."""

    client: Client
    request: RenderRequest
    scene: LoadedScene
    ladder: tuple[Rung, ...]
    """What the request's profile counts in."""
    arrived: float
    """In seconds of the engine's clock."""
    size: FrameSize
    expected: float
    """Seconds that the frame is expected to cost."""
    answer: asyncio.Future[Frame]
    loop: asyncio.AbstractEventLoop

    @property
    def is_withdrawn(self) -> bool:
        """Whether nobody wants the frame any more."""
        return self.answer.cancelled()

    def check_deadline(self, ready_at: float) -> None:
        """Raises DeadlineExceeded if the frame is of no use then."""
        deadline_ms = self.request.deadline_ms
        if deadline_ms is not None and ready_at > self.arrived + deadline_ms / 1000:
            raise DeadlineExceeded(f"The frame could not be ready within {deadline_ms:g} ms.")

    def resolve(self, answer: Frame | Exception) -> None:
        """Hand over the frame, or the reason why there is none, from any thread."""
        self.loop.call_soon_threadsafe(self._resolve, answer)

    def _resolve(self, answer: Frame | Exception) -> None:
        if self.answer.done():
            return
        if isinstance(answer, Frame):
            self.answer.set_result(answer)
        else:
            self.answer.set_exception(answer)


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """Its image, which waits to be encoded, or is."""

    work: Work
    image: Image
    rendering: float
    """Seconds that it took, without what interrupted it."""
