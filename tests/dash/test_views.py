"""A stream shows the newest view, however the render service behaves."""

from __future__ import annotations

import json

import pytest

from tests.dash.conftest import Packager, pose
from tests.dash.fakes import BUSY
from tests.dash.watching import told, until

pytestmark = pytest.mark.anyio


async def test_frames_repeat_while_the_render_service_is_slow_and_are_counted(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.gate.clear()
        await socket_.send(pose(1, 180))
        await until(lambda status: status["repeated"] >= 10, packager, session)
        assert json.loads(await socket_.recv())["pose"] == 0
        packager.render.gate.set()
        await told(socket_, lambda message: message.get("pose") == 1)
    assert len(packager.render.requests) < 6, "requests pile up at a service that is slow"


async def test_the_stream_outlives_a_render_service_that_fails(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.error = BUSY
        await socket_.send(pose(1, 180))
        await until(lambda status: status["render_failures"] >= 3, packager, session)
        assert (await packager.status(session))["render_problem"] == BUSY.detail
        before = (await packager.status(session))["frames"]
        await until(lambda status: status["frames"] > before + 10, packager, session)
        await until(lambda status: status["repeated"] > 10, packager, session)
        packager.render.error = None
        await told(socket_, lambda message: message.get("pose") == 1)
    await until(lambda status: status["render_problem"] is None, packager, session)


async def test_a_frame_that_is_cut_short_is_not_shown(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        packager.render.cut = 1
        await socket_.send(pose(1, 180))
        await until(lambda status: status["render_failures"] >= 1, packager, session)
        packager.render.cut = 0
        await told(socket_, lambda message: message.get("pose") == 1)


async def test_a_still_camera_is_not_rendered_again(packager: Packager) -> None:
    session = await packager.open()
    await until(lambda status: status["frames"] >= 30, packager, session)
    assert len(packager.render.requests) == 1
    assert (await packager.status(session))["repeated"] == 0
