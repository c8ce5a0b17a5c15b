"""One viewer's stream over any transport, and its views, always requested from the newest pose."""

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
MAX_IN_FLIGHT = 2
"""Requests in flight at the render service: one more than it renders at a time, so that it never idles."""


@dataclass(slots=True)
class Progress:
    frames: int = 0
    repeated: int = 0
    """Frames that repeat the previous view because no newer one arrived in time."""
    dropped: int = 0
    """Frames that were skipped because the stream was late."""


class Stream(ABC):
    """A running stream, run by `Sessions`."""

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
        """Rung of each representation."""
        self.progress = Progress()
        self.sent_bytes: Counter[int] = Counter()
        """Bytes of segments or datagrams, by rung."""
        self.used_at = clock.now()
        """Time of the viewer's last request or packet, on the monotonic clock."""
        self._request = request
        self._clock = clock
        self._started_at = clock.now()
        self._views = NewestView(name, source, first, clock)
        self._poses = 0

    @abstractmethod
    async def run(self) -> None:
        """Stream until cancelled, or until the stream cannot continue."""

    @property
    @abstractmethod
    def behind_s(self) -> float:
        """Time in seconds for which the next frame has been due."""

    @property
    @abstractmethod
    def watchers(self) -> int:
        """Number of viewers' connections."""

    @property
    def is_watched(self) -> bool:
        """Whether it is certainly being watched, no matter how long ago it was used."""
        return False

    @property
    def encoder_failures(self) -> int:
        """Number of frames that an encoder refused."""
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
    """Requests views from the newest pose and keeps the newest answer, starting with a given one."""

    def __init__(self, session: str, source: ViewSource, first: RawFrame, clock: Clock) -> None:
        self.failures = 0
        """Number of requests that the render service did not answer with a frame."""
        self.problem: str | None = None
        """Reason why the render service sends no frames at present."""
        self._session = session
        self._source = source
        self._clock = clock
        self._pose = source.first_pose
        self._requested: PoseUpdate | None = source.first_pose
        self.newest = first
        self._newest_number = self._request_number = 0
        self._arrived = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()

    def set_pose(self, pose: PoseUpdate) -> None:
        self._pose = pose

    @property
    def is_outdated(self) -> bool:
        """Whether a newer view is in flight, or unavailable."""
        return bool(self._requests or self.problem)

    async def wait_for_newer(self, shown: RawFrame, until: float) -> RawFrame:
        """Wait for a newer view than `shown`, at most until `until` on the monotonic clock. Returns the newest view."""
        if self._pose != self._requested and len(self._requests) < MAX_IN_FLIGHT:
            self._requested = self._pose
            self._request_number += 1
            task = asyncio.create_task(self._request(self._pose, self._request_number))
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)
        if self.newest is shown and self._requests:
            self._arrived.clear()
            # Not wait_for, which in Python 3.11 loses a cancellation that coincides with the view.
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
            self._requested = None  # repeats the request
            return
        self.problem = None
        if number > self._newest_number:  # otherwise a newer one has overtaken it
            self.newest, self._newest_number = frame, number
            self._arrived.set()
