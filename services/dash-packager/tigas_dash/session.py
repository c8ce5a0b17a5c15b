"""One viewer's stream: at each tick the view from the newest pose, encoded; media time is locked to the clock."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress

from tigas_common.errors import TigasError
from tigas_common.wire.dash import (
    FrameShown,
    PoseUpdate,
    RepresentationInfo,
    SessionInfo,
    SessionRequest,
    SessionStatus,
)
from tigas_dash.clock import Clock
from tigas_dash.cmaf.chunk import Sample, chunk
from tigas_dash.cmaf.header import init_segment
from tigas_dash.encoding import LadderEncoder, RawFrame
from tigas_dash.mpd import Stream, manifest
from tigas_dash.representation import Representation
from tigas_dash.segments import SegmentWindow
from tigas_dash.source import ViewSource

logger = logging.getLogger(__name__)

IN_FLIGHT = 2
"""Requests at the render service: one more than it renders at a time, so that it never waits for us."""
LATE_S = 0.1
"""A stream that is further behind the clock than this leaves frames out, in seconds."""
WINDOW_S = 10.0
"""How far back segments are kept, in seconds; at least three of them."""
UNREAD = 300
"""Announcements that wait for a slow reader; it misses older ones."""
_UNITS = 1000
"""Units of the timescale in one frame's duration."""


class Session:
    """A running stream. Made by `Sessions.open`, which runs it, too."""

    def __init__(
        self, name: str, request: SessionRequest, ladder: Sequence[Representation], source: ViewSource,
        encoder: LadderEncoder, first: RawFrame, clock: Clock,
    ) -> None:  # fmt: skip
        self.name = name
        self.used_at = clock.now()
        """When somebody last asked for something of it, on the steady clock."""
        self._request = request
        self._ladder = ladder
        self._source = source
        self._encoder = encoder
        self._clock = clock
        self._started_at = clock.now()
        self._pose = first_pose(request)
        self._asked: PoseUpdate | None = self._pose
        self._newest = first
        self._newest_order = self._orders = 0
        self._fresh = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()
        # One frame waits while another is encoded; a longer queue would only make a slow stream late.
        self._to_encode: asyncio.Queue[tuple[int, int, RawFrame]] = asyncio.Queue(1)
        self._pending: list[list[Sample]] = [[] for _ in ladder]
        self._pending_ticks: list[int] = []
        self._chunks = 0
        keep = max(3, round(WINDOW_S / (request.frames_per_segment / request.frame_rate)))
        self._windows = {one.id: SegmentWindow(keep) for one in ladder}
        self._keep = keep
        self._watchers: set[asyncio.Queue[FrameShown | None]] = set()
        self._frames = self._repeated = self._dropped = self._poses = self._render_failures = 0
        self._render_problem: str | None = None
        self._timescale = request.frame_rate * _UNITS
        self._headers = {
            one.id: init_segment(parameters, one.width, one.height, self._timescale)
            for one, parameters in zip(ladder, encoder.parameters, strict=True)
        }

    @property
    def info(self) -> SessionInfo:
        """What its viewer needs to know."""
        request = self._request
        return SessionInfo(
            id=self.name,
            manifest=f"/sessions/{self.name}/manifest.mpd",
            poses=f"/sessions/{self.name}/poses",
            representations=tuple(
                RepresentationInfo(
                    id=one.id, rung=one.rung, width=one.width, height=one.height, bitrate_kbps=one.bitrate_kbps,
                    codecs=parameters.codecs,
                )
                for one, parameters in zip(self._ladder, self._encoder.parameters, strict=True)
            ),
            frame_rate=request.frame_rate,
            segment_s=request.frames_per_segment / request.frame_rate,
            frames_per_chunk=request.frames_per_chunk,
            target_latency_ms=request.target_latency_ms,
        )  # fmt: skip

    @property
    def status(self) -> SessionStatus:
        """How it does."""
        return SessionStatus(
            id=self.name,
            scene=self._request.scene,
            age_s=self._clock.now() - self._started_at,
            frames=self._frames,
            repeated=self._repeated,
            dropped=self._dropped,
            poses=self._poses,
            render_failures=self._render_failures,
            render_problem=self._render_problem,
            encoder_failures=self._encoder.failures,
            watchers=len(self._watchers),
        )

    def manifest(self, time_url: str) -> bytes:
        """The MPD."""
        request = self._request
        stream = Stream(
            start=self._clock.wall(self._started_at),
            ladder=self._ladder,
            codecs=[parameters.codecs for parameters in self._encoder.parameters],
            frame_rate=request.frame_rate,
            timescale=self._timescale,
            frames_per_segment=request.frames_per_segment,
            frames_per_chunk=request.frames_per_chunk,
            window_segments=self._keep,
            target_latency_ms=request.target_latency_ms,
            time_url=time_url,
        )
        return manifest(stream, self._clock.wall(self._clock.now()))

    def header(self, representation: str) -> bytes | None:
        """The init segment; None if there is no such representation."""
        return self._headers.get(representation)

    def window(self, representation: str) -> SegmentWindow | None:
        """The media segments, likewise."""
        return self._windows.get(representation)

    @property
    def readable_s(self) -> float:
        """How long a segment can be read after its start."""
        return (self._keep + 1) * self._request.frames_per_segment / self._request.frame_rate

    def move(self, pose: PoseUpdate) -> None:
        """The viewer's newest pose."""
        self._pose = pose
        self._poses += 1

    @asynccontextmanager
    async def watch(self) -> AsyncIterator[asyncio.Queue[FrameShown | None]]:
        """Announcements of frames for as long as the context lasts; None when the stream has ended."""
        queue: asyncio.Queue[FrameShown | None] = asyncio.Queue(UNREAD)
        self._watchers.add(queue)
        try:
            yield queue
        finally:
            self._watchers.discard(queue)
            self.used_at = self._clock.now()

    @property
    def watched(self) -> bool:
        """Whether a viewer's pose socket is open."""
        return bool(self._watchers)

    async def run(self) -> None:
        """Stream until cancelled, or until the encoder fails for good."""
        executor = ThreadPoolExecutor(1, f"encoder-{self.name}")
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._tick())
                tasks.create_task(self._encode(executor))
        except* TigasError as failed:
            logger.error("Session %s ends: %s", self.name, failed.exceptions[0])  # noqa: TRY400 - a sentence says it all
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            for task in self._requests:
                task.cancel()
            for window in self._windows.values():
                window.close()
            self._tell(None)

    async def _tick(self) -> None:
        """Frame n is the newest view between its tick and the next one; if none comes, the last one again.

        Media time stays with the clock even if the encoder does not, or the process was stopped: see `_lasts`.
        """
        shown = self._newest
        number = 0
        while True:
            await self._clock.sleep_until(self._due(number))
            ticks = self._lasts(number)
            frame = await self._view(shown, self._due(number + ticks))
            if frame is shown and (self._requests or self._render_problem):
                self._repeated += 1
            shown = frame
            await self._to_encode.put((number, ticks, frame))
            number += ticks

    def _due(self, number: int) -> float:
        return self._started_at + number / self._request.frame_rate

    def _lasts(self, number: int) -> int:
        """For how many ticks a frame is shown: one, or up to the present if it is late, but not beyond its segment."""
        late_s = self._clock.now() - self._due(number)
        if late_s <= LATE_S:
            return 1
        left = self._request.frames_per_segment - number % self._request.frames_per_segment
        return min(left, math.floor(late_s * self._request.frame_rate) + 1)

    async def _view(self, shown: RawFrame, until: float) -> RawFrame:
        """A newer view than the one that is shown, as soon as it is there; or that one, at the end of its time."""
        if self._pose != self._asked and len(self._requests) < IN_FLIGHT:
            self._asked = self._pose
            self._orders += 1
            task = asyncio.create_task(self._render(self._pose, self._orders))
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)
        if self._newest is shown and self._requests:
            self._fresh.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._fresh.wait(), max(0.0, until - self._clock.now()))
        return self._newest

    async def _render(self, pose: PoseUpdate, order: int) -> None:
        try:
            frame = await self._source.frame(pose)
        except TigasError as error:
            self._render_failures += 1
            if self._render_problem is None:
                logger.warning("Session %s repeats its last frame: %s", self.name, error.detail)
            self._render_problem = error.detail
            self._asked = None  # ask again
            return
        self._render_problem = None
        if order > self._newest_order:  # else a newer one has overtaken it
            self._newest, self._newest_order = frame, order
            self._fresh.set()

    async def _encode(self, executor: ThreadPoolExecutor) -> None:
        loop = asyncio.get_running_loop()
        while True:
            number, ticks, frame = await self._to_encode.get()
            samples = await loop.run_in_executor(executor, self._encoder.encode, frame, number)
            self._publish(number, ticks, samples)
            self._tell(FrameShown(frame=number, media_time_s=number / self._request.frame_rate, pose=frame.pose))

    def _tell(self, message: FrameShown | None) -> None:
        for queue in self._watchers:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(message)

    def _publish(self, number: int, ticks: int, samples: Sequence[Sample]) -> None:
        for pending, sample in zip(self._pending, samples, strict=True):
            pending.append(sample)
        self._pending_ticks.append(ticks)
        self._frames += 1
        self._dropped += ticks - 1
        per_segment, per_chunk = self._request.frames_per_segment, self._request.frames_per_chunk
        begin = number % per_segment
        end = begin + ticks
        if end // per_chunk > begin // per_chunk or end == per_segment:
            self._publish_chunk(number + ticks - sum(self._pending_ticks))

    def _publish_chunk(self, first: int) -> None:
        """Hand out what is pending; its first frame is number `first`."""
        self._chunks += 1
        segment, place = divmod(first, self._request.frames_per_segment)
        durations = [ticks * _UNITS for ticks in self._pending_ticks]
        self._pending_ticks.clear()
        for one, pending in zip(self._ladder, self._pending, strict=True):
            data = chunk(
                pending,
                durations,
                sequence=self._chunks,
                decode_time=first * _UNITS,
                captured=self._clock.wall(self._due(first)),
                first=place == 0,
            )
            self._windows[one.id].append(segment + 1, data)
            pending.clear()


def first_pose(request: SessionRequest) -> PoseUpdate:
    """The pose that a stream begins with, number 0."""
    return PoseUpdate(seq=0, position=request.position, quaternion=request.quaternion)
