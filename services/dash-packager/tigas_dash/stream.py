"""One viewer's stream, however it travels, and its views: the newest one, requested from the newest pose."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar, Literal

from tigas_common.errors import TigasError
from tigas_common.wire.dash import PoseUpdate, SessionStatus, StreamRequest
from tigas_dash.clock import Clock
from tigas_dash.encoder import RawFrame
from tigas_dash.source import ViewSource

logger = logging.getLogger(__name__)

Transport = Literal["dash", "webrtc"]
IN_FLIGHT = 2
"""Requests in flight at the render service: one more than it renders at a time, so that it never waits for us."""


@dataclass(slots=True)
class Progress:
    frames: int = 0
    repeated: int = 0
    """Frames that repeat the last view because no newer one arrived in time."""
    dropped: int = 0
    """Frames that were left out, as the stream was late."""


class Stream(ABC):
    """A running stream. `Sessions` runs it."""

    transport: ClassVar[Transport]

    def __init__(
        self,
        name: str,
        request: StreamRequest,
        rungs: tuple[int, ...],
        source: ViewSource,
        first: RawFrame,
        clock: Clock,
    ) -> None:
        self.name = name
        self.rungs = rungs
        """One for each representation."""
        self.progress = Progress()
        self.sent_bytes: Counter[int] = Counter()
        """Bytes of segments or datagrams, by rung."""
        self.used_at = clock.now()
        """Time of the viewer's last request or packet, on the steady clock."""
        self._request = request
        self._clock = clock
        self._started_at = clock.now()
        self._views = NewestView(name, source, first, clock)
        self._poses = 0

    @abstractmethod
    async def run(self) -> None:
        """Stream until cancelled, or until the stream cannot go on."""

    @property
    @abstractmethod
    def behind_s(self) -> float:
        """For how long the next frame has been due, in seconds."""

    @property
    @abstractmethod
    def watchers(self) -> int:
        """Connections of viewers."""

    @property
    def watched(self) -> bool:
        """Whether it is certainly being watched, however long ago it was used."""
        return False

    @property
    def encoder_failures(self) -> int:
        """Frames that an encoder refused."""
        return 0

    @property
    def status(self) -> SessionStatus:
        return SessionStatus(
            id=self.name,
            scene=self._request.scene,
            age_s=self._clock.now() - self._started_at,
            frames=self.progress.frames,
            repeated=self.progress.repeated,
            dropped=self.progress.dropped,
            poses=self._poses,
            render_failures=self._views.failures,
            render_problem=self._views.problem,
            encoder_failures=self.encoder_failures,
            watchers=self.watchers,
        )


class NewestView:
    """Requests the view from the newest pose, and keeps the newest answer. Starts with a given one."""

    def __init__(self, session: str, source: ViewSource, first: RawFrame, clock: Clock) -> None:
        self.failures = 0
        """Requests that the render service did not answer with a frame."""
        self.problem: str | None = None
        """Why it gives no frames at present."""
        self._session = session
        self._source = source
        self._clock = clock
        self._pose = source.first_pose
        self._requested: PoseUpdate | None = source.first_pose
        self.newest = first
        self._newest_number = self._request_number = 0
        self._arrived = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()

    def move(self, pose: PoseUpdate) -> None:
        self._pose = pose

    @property
    def outdated(self) -> bool:
        """Whether a newer view is in flight, or unavailable."""
        return bool(self._requests or self.problem)

    async def after(self, shown: RawFrame, until: float) -> RawFrame:
        """The next view as soon as it is available, or the present one at the end of its time."""
        if self._pose != self._requested and len(self._requests) < IN_FLIGHT:
            self._requested = self._pose
            self._request_number += 1
            task = asyncio.create_task(self._request(self._pose, self._request_number))
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)
        if self.newest is shown and self._requests:
            self._arrived.clear()
            # Not wait_for, which in Python 3.11 forgets a cancellation that comes together with the view.
            with suppress(TimeoutError):
                async with asyncio.timeout(until - self._clock.now()):
                    await self._arrived.wait()
        return self.newest

    def close(self) -> None:
        """Cancel all requests."""
        for task in self._requests:
            task.cancel()

    async def _request(self, pose: PoseUpdate, number: int) -> None:
        try:
            frame = await self._source.frame(pose)
        except TigasError as error:
            self.failures += 1
            if self.problem is None:
                logger.warning("Session %s repeats its last frame: %s", self._session, error.detail)
            self.problem = error.detail
            self._requested = None  # ask again
            return
        self.problem = None
        if number > self._newest_number:  # else a newer one has overtaken it
            self.newest, self._newest_number = frame, number
            self._arrived.set()
