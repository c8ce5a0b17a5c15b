"""A stream on a simulated clock, which advances only for waiting and work."""

from __future__ import annotations

import asyncio
import io
import json
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

import av
import httpx
import pytest

from tests.dash.conftest import PATIENCE_S, Packager, announcement, parsed_request, pose
from tests.dash.fakes import BUSY, FakeClock, grey
from tigas_common.render_requests import RenderClient
from tigas_common.wire.dash import FrameShown, PoseUpdate
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_dash.clock import Clock
from tigas_dash.cmaf import Sample
from tigas_dash.encoder import LadderEncoder, RawFrame
from tigas_dash.errors import ExpiredSegment
from tigas_dash.representation import choose_representations
from tigas_dash.session import MAX_UNREAD, DashStream
from tigas_dash.source import ViewSource
from tigas_dash.stream import NewestView

pytestmark = pytest.mark.anyio
RATE, PER_SEGMENT = 30, 15
Announcements = asyncio.Queue[FrameShown | None]


class SlowEncoder(LadderEncoder):
    """Takes some time on the fake clock."""

    clock: FakeClock
    takes_s: float

    def encode(self, frame: RawFrame, number: int) -> list[Sample]:
        self.clock.work(self.takes_s)
        return super().encode(frame, number)


@asynccontextmanager
async def streaming(clock: FakeClock, takes_s: float = 0.001, **changes: Any) -> AsyncIterator[DashStream]:
    """A stream of a still camera, as a context manager; `takes_s` is the encoding time of a frame."""
    request = parsed_request(**changes)
    ladder = choose_representations(request, DEFAULT_LADDER)
    encoder = SlowEncoder("libx264", ladder, request.frame_rate, request.frames_per_segment)
    encoder.clock, encoder.takes_s = clock, takes_s
    width, height = ladder[0].width, ladder[0].height
    first = RawFrame(grey(width, height, 100), width, height, 0)
    async with httpx.AsyncClient() as nobody, asyncio.timeout(PATIENCE_S):
        source = ViewSource(RenderClient(nobody), request, ladder[0])
        session = DashStream("session", request, ladder, source, encoder, first, clock)
        running = asyncio.create_task(session.run())
        try:
            yield session
        finally:
            running.cancel()
            await asyncio.wait([running])


async def told(frames: Announcements, media_time_s: float) -> FrameShown:
    """The first announcement of a frame at that time or later."""
    while (shown := await frames.get()) is None or shown.media_time_s < media_time_s:
        assert shown is not None, "the stream has ended"
    return shown


async def samples(session: DashStream, representation: str, segments: Sequence[int]) -> list[tuple[int, int, bool]]:
    """Of each frame in some segments: its tick, for how many it lasts, and whether it is a keyframe."""
    data, window = session.media.track(representation).header, session.media.track(representation).segments
    for number in segments:
        data += b"".join([part async for part in window.read(number)])
    with av.open(io.BytesIO(data), "r") as container:
        ticks = container.streams.video[0].time_base * RATE  # type: ignore[operator]
        return [
            (round((one.pts or 0) * ticks), round((one.duration or 0) * ticks), one.is_keyframe)
            for one in container.demux(video=0)
            if one.size
        ]


async def test_media_time_stays_with_the_clock_though_the_encoder_is_too_slow() -> None:
    clock = FakeClock()
    async with streaming(clock, takes_s=0.08) as session, session.subscribe() as frames:
        for tenth in range(100):
            shown = await told(frames, tenth / 10)
            assert clock.now() - shown.media_time_s < 0.6
        status = session.status
    assert status.dropped > status.frames > 50


@pytest.mark.parametrize("frames_per_chunk", [1, 4])
async def test_a_process_that_was_stopped_goes_on_at_the_present_and_no_segment_is_missing(
    frames_per_chunk: int,
) -> None:
    clock = FakeClock()
    both = [{"rung": 2}, {"rung": 3}]
    async with (
        streaming(clock, representations=both, frames_per_chunk=frames_per_chunk) as session,
        session.subscribe() as frames,
    ):
        await told(frames, 1.2)
        clock.wait(3.3)
        await told(frames, 6)
        for name in ("r2-1414", "r3-500"):
            found = await samples(session, name, range(1, 11))
            assert found[0][0] == 0
            assert all(begins + lasts == after for (begins, lasts, _), (after, _, _) in pairwise(found))
            assert {begins for begins, _, keyframe in found if keyframe} == set(range(0, 10 * PER_SEGMENT, PER_SEGMENT))
            assert max(lasts for _, lasts, _ in found) == PER_SEGMENT
        status = session.status
    assert status.dropped == pytest.approx(3.3 * RATE, abs=15)


async def test_segments_are_kept_for_as_long_as_the_manifest_says_and_no_longer() -> None:
    async with streaming(FakeClock()) as session, session.subscribe() as frames:
        depth_s = float(
            ET.fromstring(session.media.manifest("", FakeClock().wall_now())).attrib["timeShiftBufferDepth"][2:-1]
        )
        now = await told(frames, 12)
        window = session.media.track("r3-500").segments
        segment_s = PER_SEGMENT / RATE
        # After its end, a segment is available for that long and its own duration (ISO/IEC 23009-1, 5.3.9.5.3).
        available = [n for n in range(1, 25) if n * segment_s + depth_s + segment_s > now.media_time_s]
        window.read(available[0])
        with pytest.raises(ExpiredSegment):
            window.read(available[0] - 1)


def test_wall_clock_time_follows_the_steady_clock() -> None:
    clock = FakeClock()
    clock.wait(61.5)
    assert clock.wall_now() == datetime(2026, 1, 31, 12, 1, 1, 500_000, tzinfo=UTC)


async def test_a_listener_that_was_away_hears_the_newest_frames() -> None:
    async with streaming(FakeClock()) as session, session.subscribe() as away, session.subscribe() as frames:
        newest = await told(frames, (MAX_UNREAD + 60) / RATE)
        waiting = [away.get_nowait() for _ in range(away.qsize())]
    assert len(waiting) == MAX_UNREAD
    assert waiting[-1] is not None
    assert waiting[-1].frame >= newest.frame


async def test_frames_repeat_while_the_render_service_is_slow_and_are_counted(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.gate.clear()
        await socket_.send(pose(1, 180))
        await packager.until(session, lambda status: status["repeated"] >= 10)
        assert json.loads(await socket_.recv())["pose"] == 0
        packager.render.gate.set()
        await announcement(socket_, lambda message: message.get("pose") == 1)
    assert len(packager.render.requests) < 6, "requests pile up at a service that is slow"


async def test_the_stream_outlives_a_render_service_that_fails(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.error = BUSY
        await socket_.send(pose(1, 180))
        await packager.until(session, lambda status: status["render_failures"] >= 3)
        assert (await packager.status(session))["render_problem"] == BUSY.detail
        before = (await packager.status(session))["frames"]
        await packager.until(session, lambda status: status["frames"] > before + 10)
        await packager.until(session, lambda status: status["repeated"] > 10)
        packager.render.error = None
        await announcement(socket_, lambda message: message.get("pose") == 1)
    await packager.until(session, lambda status: status["render_problem"] is None)


async def test_a_frame_that_is_cut_short_is_not_shown(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.cut = 1
        await socket_.send(pose(1, 180))
        await packager.until(session, lambda status: status["render_failures"] >= 1)
        packager.render.cut = 0
        await announcement(socket_, lambda message: message.get("pose") == 1)


async def test_a_still_camera_is_not_rendered_again(packager: Packager) -> None:
    session = await packager.open()
    await packager.until(session, lambda status: status["frames"] >= 30)
    assert len(packager.render.requests) == 1
    assert (await packager.status(session))["repeated"] == 0


class Source(ViewSource):
    """Gives frames when the test lets it."""

    def __init__(self) -> None:
        self.first_pose = PoseUpdate(seq=0, position=(0, 0, 0), quaternion=(0, 0, 0, 1))
        self.gate = asyncio.Event()

    async def frame(self, pose: PoseUpdate, within_s: float = 0) -> RawFrame:
        await self.gate.wait()
        return RawFrame(b"", 1, 1, pose.seq)


@pytest.mark.parametrize("turns", range(6))
async def test_a_stream_that_ends_just_as_a_frame_comes_does_end(turns: int) -> None:
    source, first, clock = Source(), RawFrame(b"", 1, 1, 0), Clock()
    views = NewestView("a", source, first, clock)
    views.set_pose(PoseUpdate(seq=1, position=(1, 0, 0), quaternion=(0, 0, 0, 1)))
    waiting = asyncio.create_task(views.wait_for_newer(first, clock.now() + 60))
    for turn in range(3 + turns):
        if turn == 3:
            source.gate.set()
        await asyncio.sleep(0)
    ends = waiting.cancel()
    await asyncio.wait([waiting])
    assert waiting.cancelled() == ends
