"""The video that aiortc encodes and sends: the newest view at each tick, with timestamps that follow the clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import av
from aiortc import MediaStreamTrack

from tigas_dash.clock import Clock
from tigas_dash.stream import NewestView, Progress

RTP_RATE = 90_000
"""Ticks per second of a video's RTP timestamps (RFC 6184, RFC 7741)."""
REPEAT_AFTER_S = 0.25
"""Seconds between repeats of the last view while a newer one is on its way, which encoding would delay."""


class ViewTrack(MediaStreamTrack):
    """Polled for the next frame once the previous one has been encoded and sent, so a slow encoder skips frames."""

    kind = "video"

    def __init__(
        self,
        views: NewestView,
        frame_rate: int,
        clock: Clock,
        progress: Progress,
        sent: Callable[[int, int], None],
    ) -> None:
        """sent: called for each sent frame with its timestamp, in RTP_RATE since the first frame, and its pose."""
        super().__init__()
        self._views = views
        self._frame_rate = frame_rate
        self._clock = clock
        self._progress = progress
        self._sent = sent
        self._shown = views.newest
        self._started_at: float | None = None
        self._number = -1

    @property
    def behind_s(self) -> float:
        """Seconds for which its next frame has been due; 0 before the first one."""
        return 0.0 if self._started_at is None else max(0.0, self._clock.now() - self._due_at)

    async def recv(self) -> av.VideoFrame:
        """The newest view at the next tick; if a newer one is on its way, waits for it up to REPEAT_AFTER_S."""
        if self._started_at is None:
            self._started_at = self._clock.now()
        else:
            self._sent(self._timestamp, self._shown.pose)
        await self._clock.sleep_until(self._due_at)
        view = await self._views.wait_for_newer(self._shown, self._clock.now() + REPEAT_AFTER_S)
        if view is self._shown and self._views.is_outdated:
            self._progress.repeated += 1
        self._shown = view
        due = math.floor((self._clock.now() - self._started_at) * self._frame_rate)
        number = max(self._number + 1, due) if self._number >= 0 else 0  # timestamps count from the first frame
        self._progress.dropped += number - self._number - 1
        self._number = number
        self._progress.frames += 1
        frame = view.video_frame()
        frame.pts, frame.time_base = self._timestamp, Fraction(1, RTP_RATE)
        return frame

    @property
    def _due_at(self) -> float:
        """Time of the next frame, on the monotonic clock."""
        assert self._started_at is not None
        return self._started_at + (self._number + 1) / self._frame_rate

    @property
    def _timestamp(self) -> int:
        return self._number * RTP_RATE // self._frame_rate
