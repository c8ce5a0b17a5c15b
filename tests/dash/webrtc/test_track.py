"""The video's frames: the newest view at each tick, with timestamps of the clock."""

from __future__ import annotations

import pytest

from tests.dash.fakes import FakeClock, grey
from tigas_dash.encoder import RawFrame
from tigas_dash.stream import Progress
from tigas_dash.webrtc.track import ViewTrack

pytestmark = pytest.mark.anyio


class FakeViews:
    """A view that arrives after `delay_s`, for each request; it stands still once it is None."""

    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock
        self.delay_s: float | None = 0.01
        self.newest = self._view(0)
        self.is_outdated = False

    async def wait_for_newer(self, shown: RawFrame, until: float) -> RawFrame:
        if self.delay_s is None:
            self.is_outdated = False
            return shown
        arrives = self.clock.now() + self.delay_s
        self.is_outdated = arrives > until
        self.clock.wait(min(until, arrives) - self.clock.now())
        if not self.is_outdated:
            self.newest = self._view(self.newest.pose + 1)
        return self.newest

    @staticmethod
    def _view(pose: int) -> RawFrame:
        return RawFrame(grey(32, 16, 10 * pose), 32, 16, pose)


async def timestamp(track: ViewTrack) -> int:
    pts = (await track.recv()).pts
    assert pts is not None
    return pts


async def test_frames_are_the_newest_views_at_the_ticks_and_slow_ones_leave_ticks_out() -> None:
    clock, progress, sent = FakeClock(), Progress(), list[tuple[int, int]]()
    views = FakeViews(clock)
    track = ViewTrack(views, 30, clock, progress, lambda *frame: sent.append(frame))  # type: ignore[arg-type]
    pictures = [await track.recv() for _ in range(3)]
    assert [picture.pts for picture in pictures] == [0, 3000, 6000]
    assert [round(picture.to_ndarray()[:16].mean()) for picture in pictures] == [10, 20, 30]
    assert sent == [(0, 1), (3000, 2)], "told before it was sent"
    assert progress == Progress(3, 0, 0)
    views.delay_s = 0.11  # a renderer that is too slow: ticks are left out, and nothing is sent again meanwhile
    pictures = [await track.recv() for _ in range(2)]
    assert [picture.pts for picture in pictures] == [18_000, 30_000]
    assert (progress.repeated, progress.dropped) == (0, 6)
    views.delay_s = 9
    assert await timestamp(track) > 30_000 + 0.25 * 90_000
    assert progress.repeated == 1
    views.delay_s, dropped = None, progress.dropped  # the camera stands still
    before = await timestamp(track)
    assert [await timestamp(track) for _ in range(2)] == [before + 3000, before + 6000]
    assert (progress.repeated, progress.dropped) == (1, dropped)


async def test_timestamps_count_from_the_first_frame_however_late_it_is() -> None:
    clock = FakeClock()
    views = FakeViews(clock)
    views.delay_s = 0.11
    track = ViewTrack(views, 30, clock, Progress(), lambda *_: None)  # type: ignore[arg-type]
    assert await timestamp(track) == 0
