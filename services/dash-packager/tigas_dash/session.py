"""One viewer's DASH stream: the newest view is encoded at each tick, and media time is locked to the clock."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

from tigas_common.errors import TigasError
from tigas_common.wire.dash import FrameShown, PoseUpdate, SessionInfo, SessionRequest
from tigas_dash.clock import Clock
from tigas_dash.encoder import LadderEncoder, RawFrame
from tigas_dash.media import Media
from tigas_dash.representation import Representation
from tigas_dash.source import ViewSource
from tigas_dash.stream import Stream

logger = logging.getLogger(__name__)

SKIP_AFTER_S = 0.1
"""Seconds behind the clock above which a stream skips frames."""
MAX_UNREAD = 300
"""Maximum number of announcements queued for a slow reader, which misses older ones."""


class DashStream(Stream):
    """A DASH stream, created and run by `Sessions.open`."""

    transport = "dash"
    _request: SessionRequest

    def __init__(
        self, name: str, request: SessionRequest, ladder: Sequence[Representation], source: ViewSource,
        encoder: LadderEncoder, first: RawFrame, clock: Clock,
    ) -> None:  # fmt: skip
        super().__init__(name, request, tuple(one.rung for one in ladder), source, first, clock)
        self.media = Media(request, ladder, encoder.parameters, clock.wall_time(self._started_at))
        self._next = 0
        """Number of the next frame to encode."""
        self._encoder = encoder
        # One frame waits while another is encoded; a longer queue would only delay a slow stream.
        self._to_encode: asyncio.Queue[tuple[int, int, RawFrame]] = asyncio.Queue(1)
        self._watchers: set[asyncio.Queue[FrameShown | None]] = set()

    @property
    def info(self) -> SessionInfo:
        """Description of the stream for the viewer."""
        request = self._request
        return SessionInfo(
            id=self.name,
            manifest=f"/sessions/{self.name}/manifest.mpd",
            poses=f"/sessions/{self.name}/poses",
            representations=tuple(track.info for track in self.media.tracks),
            frame_rate=request.frame_rate,
            segment_s=request.frames_per_segment / request.frame_rate,
            frames_per_chunk=request.frames_per_chunk,
            target_latency_ms=request.target_latency_ms,
        )

    @property
    def behind_s(self) -> float:
        return max(0.0, self._clock.now() - self._due_at(self._next))

    @property
    def watchers(self) -> int:
        return len(self._watchers)

    @property
    def is_watched(self) -> bool:
        return bool(self._watchers)

    @property
    def encoder_failures(self) -> int:
        return self._encoder.failures

    def count_sent(self, rung: int, size: int) -> None:
        """Count bytes of a rung's segments that were sent to a client."""
        self.sent_bytes[rung] += size
        self.used_at = self._clock.now()

    def set_pose(self, pose: PoseUpdate) -> None:
        self._views.set_pose(pose)
        self._poses += 1

    @asynccontextmanager
    async def subscribe(self) -> AsyncIterator[asyncio.Queue[FrameShown | None]]:
        """Subscribe to announcements of frames, as a context manager; None means that the stream has ended."""
        queue: asyncio.Queue[FrameShown | None] = asyncio.Queue(MAX_UNREAD)
        self._watchers.add(queue)
        try:
            yield queue
        finally:
            self._watchers.discard(queue)
            self.used_at = self._clock.now()

    async def run(self) -> None:
        executor = ThreadPoolExecutor(1, f"encoder-{self.name}")
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._keep_sampling())
                tasks.create_task(self._keep_encoding(executor))
        except* TigasError as failed:
            logger.error("Session %s ends: %s", self.name, failed.exceptions[0])  # noqa: TRY400 - a sentence says it all
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            self._views.close()
            self.media.close()
            self._announce(None)

    async def _keep_sampling(self) -> None:
        """Frame n is the newest view between its tick and the next one, or the previous view if none arrives.

        Media time follows the clock even if the encoder is late or the process was stopped: see `_duration_ticks`.
        """
        shown = self._views.newest
        number = 0
        while True:
            await self._clock.sleep_until(self._due_at(number))
            ticks = self._duration_ticks(number)
            frame = await self._views.wait_for_newer(shown, self._due_at(number + ticks))
            if frame is shown and self._views.is_outdated:
                self.progress.repeated += 1
            shown = frame
            await self._to_encode.put((number, ticks, frame))
            number += ticks

    def _due_at(self, number: int) -> float:
        return self._started_at + number / self._request.frame_rate

    def _duration_ticks(self, number: int) -> int:
        """Duration of a frame in ticks: one or, if it is late, up to the present within its segment."""
        late_s = self._clock.now() - self._due_at(number)
        if late_s <= SKIP_AFTER_S:
            return 1
        left = self._request.frames_per_segment - number % self._request.frames_per_segment
        return min(left, math.floor(late_s * self._request.frame_rate) + 1)

    async def _keep_encoding(self, executor: ThreadPoolExecutor) -> None:
        loop = asyncio.get_running_loop()
        while True:
            number, ticks, frame = await self._to_encode.get()
            samples = await loop.run_in_executor(executor, self._encoder.encode, frame, number)
            self.media.append(number, ticks, samples)
            self._next = number + ticks
            self.progress.frames += 1
            self.progress.dropped += ticks - 1
            self._announce(FrameShown(frame=number, media_time_s=number / self._request.frame_rate, pose=frame.pose))

    def _announce(self, message: FrameShown | None) -> None:
        for queue in self._watchers:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(message)
