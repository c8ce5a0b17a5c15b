"""A stream shows the newest view, however the render service behaves."""

from __future__ import annotations

import asyncio
import json

import pytest

from tests.dash.conftest import Packager, announcement, pose
from tests.dash.fakes import BUSY
from tigas_common.wire.dash import PoseUpdate
from tigas_dash.clock import Clock
from tigas_dash.encoder import RawFrame
from tigas_dash.source import ViewSource
from tigas_dash.views import NewestView

pytestmark = pytest.mark.anyio


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
    views.move(PoseUpdate(seq=1, position=(1, 0, 0), quaternion=(0, 0, 0, 1)))
    waiting = asyncio.create_task(views.after(first, clock.now() + 60))
    for turn in range(3 + turns):
        if turn == 3:
            source.gate.set()
        await asyncio.sleep(0)
    ends = waiting.cancel()
    await asyncio.wait([waiting])
    assert waiting.cancelled() == ends
