"""The engine's work items, each a request on its way to a frame, and a queue from threads to the event loop."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from tigas_common.errors import DeadlineExceeded
from tigas_common.wire.render import RenderRequest, Rung
from tigas_render.engine.frame_size import FrameSize
from tigas_render.frame import Client, OnAnswer
from tigas_render.raster.base import PreparedScene

Item = TypeVar("Item")

logger = logging.getLogger(__name__)


class LoadedScene(Protocol):
    """The engine's interface to a scene in use."""

    @property
    def prepared(self) -> PreparedScene:
        """The scene on the rasteriser's device."""

    @property
    def background(self) -> tuple[float, float, float]:
        """RGB, 0 to 1."""

    @property
    def ladder(self) -> tuple[Rung, ...] | None:
        """The scene's own quality levels, the best first, if it has them."""

    @property
    def is_coarse(self) -> bool:
        """Whether this is a coarse stand-in for a scene that is still loading."""


class SceneUse(Protocol):
    """Holds a scene in memory, from `enter` or `enter_if_loaded` until `leave`."""

    def enter_if_loaded(self) -> LoadedScene | None:
        """The scene; None if it must be loaded first. Raises UnknownScene."""

    async def enter(self) -> LoadedScene:
        """The scene, loaded if necessary. Raises UnknownScene, BrokenScene and Overloaded."""

    def leave(self) -> None:
        """Allow the scene to be unloaded again."""


@dataclass(slots=True, eq=False)
class Work:
    """A request, until it is answered or withdrawn. Only the event loop changes it."""

    client: Client
    request: RenderRequest
    arrived: float
    """When the request arrived, in seconds of the engine's clock."""
    scene_use: SceneUse
    on_answer: OnAnswer | None
    """Callback for the frame or error; None once the request is answered or cancelled."""
    loading: asyncio.Task[None] | None = None
    """The task that waits for the scene to load."""
    is_retry: bool = False
    holds_scene: bool = False
    """Whether the scene is in use for this work; the fields below are set only then."""
    scene: LoadedScene = field(init=False)
    ladder: tuple[Rung, ...] = field(init=False)
    """The ladder that the request's profile indexes."""
    size: FrameSize = field(init=False)
    expected: float = field(init=False)
    """Expected cost of the frame, in seconds."""

    @property
    def quality(self) -> int:
        """JPEG quality of its rung."""
        return self.ladder[self.request.profile or 0].quality

    @property
    def is_over(self) -> bool:
        """Whether the frame is no longer wanted."""
        return self.on_answer is None

    def check_deadline(self, ready_at: float) -> None:
        """Raise DeadlineExceeded if a frame that is ready at this time would be too late."""
        deadline_ms = self.request.deadline_ms
        if deadline_ms is not None and ready_at > self.arrived + deadline_ms / 1000:
            raise DeadlineExceeded(f"The frame could not be ready within {deadline_ms:g} ms.")


class CallbackQueue(Generic[Item]):
    """Passes items from threads to `receive`, in order, on the event loop that created it.

    One wakeup serves all items put before the loop reads them, because a wakeup is a system call for which the thread
    gives up the interpreter's lock.
    """

    def __init__(self, receive: Callable[[Item], None]) -> None:
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._items: deque[Item] = deque()
        self._is_woken = False

    def put(self, item: Item) -> None:
        """Hand over an item, from any thread; the loop receives it later, never during this call."""
        self._items.append(item)
        if not self._is_woken:
            self._is_woken = True
            self._loop.call_soon_threadsafe(self.deliver)

    def deliver(self) -> None:
        """Receive all items so far. Must be called on the event loop."""
        self._is_woken = False  # first, so that any item put from here on wakes the loop again
        for _ in range(len(self._items)):
            try:
                self._receive(self._items.popleft())
            except Exception:  # a failure must not lose the remaining answers
                logger.exception("An answer was not delivered")
