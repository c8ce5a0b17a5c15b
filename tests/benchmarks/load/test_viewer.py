"""A viewer against the real HTTP/3 server: the outcome of every wanted frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from benchmarks.load.plan import Plan, Transport
from benchmarks.load.viewer import IN_FLIGHT, Viewer
from tests.eventually import eventually
from tests.render.transport.client import FakeFrames
from tests.render.transport.serving import served
from tigas_common.errors import Overloaded, Superseded
from tigas_render.transport.server import Http3Server

pytestmark = pytest.mark.anyio

VIEW = '"scene":"demo","fx":900,"fy":900,"cx":640,"cy":360,"width":1280,"height":720,"profile":2'
POSES = tuple(f'"position":[{step},0,0],"quaternion":[0,0,0,1]' for step in range(5))


@asynccontextmanager
async def viewing(
    source: FakeFrames, transport: Transport = "webtransport", frames_per_s: float = 200
) -> AsyncIterator[tuple[Viewer, Http3Server]]:
    async with served(source=source) as server:
        viewer = Viewer(Plan("127.0.0.1", server.port, transport, frames_per_s, VIEW, (POSES,)), 0)
        viewer.come()
        try:
            yield viewer, server
        finally:
            viewer.leave()


def fates(viewer: Viewer) -> Counter[str]:
    return Counter(due.fate for due in viewer.ended)


async def test_frames_are_counted_to_their_last_byte() -> None:
    source = FakeFrames(bytes(200_000))
    async with viewing(source, frames_per_s=50) as (viewer, _):
        await eventually(lambda: fates(viewer)["served"] >= 10)
    served_frames = [due for due in viewer.ended if due.fate == "served"]
    assert all(due.size == 200_000 for due in served_frames)
    assert all(0 < due.took < 10 and 0 <= due.lag < 10 for due in served_frames)
    assert set(fates(viewer)) <= {"served", "overtaken", "superseded", "outside", "waiting"}


async def test_a_viewer_walks_along_its_movement_and_begins_anew() -> None:
    source = FakeFrames()
    async with viewing(source) as (viewer, _):
        await eventually(lambda: fates(viewer)["served"] >= 10)
    asked = [request for _, request in source.requests]
    assert [request.seq for request in asked] == list(range(1, len(asked) + 1))
    places = {request.position and request.position[0] for request in asked}
    assert places == {0, 1, 2, 3, 4}


async def test_frames_over_post() -> None:
    async with viewing(FakeFrames(), "post") as (viewer, _):
        await eventually(lambda: fates(viewer)["served"] >= 10)
    assert {due.size for due in viewer.ended if due.fate == "served"} == {len("/render")}


async def test_what_a_newer_frame_has_overtaken_is_cancelled() -> None:
    source = FakeFrames()
    source.held = {3}
    async with viewing(source) as (viewer, _):
        await source.until(lambda: source.cancelled == [3])
        await eventually(lambda: fates(viewer)["overtaken"])
    assert fates(viewer)["overtaken"] == 1


async def test_a_viewer_keeps_to_the_rate_that_it_is_told() -> None:
    source = FakeFrames()
    async with viewing(source) as (viewer, _):
        await eventually(lambda: fates(viewer)["served"])
        answer = viewer._answer

        async def limited(*arguments: Any) -> tuple[int, float | None, int]:
            status, _, size = await answer(*arguments)
            return status, 50.0, size

        viewer._answer = limited  # type: ignore[method-assign, assignment]
        await eventually(lambda: fates(viewer)["paced"])
        viewer.ended.clear()
        await eventually(lambda: len(viewer.ended) >= 40)
    asked = fates(viewer).total() - fates(viewer)["paced"]
    assert asked == pytest.approx(fates(viewer).total() * 50 / 200, rel=0.3)


@pytest.mark.parametrize(("error", "fate"), [(Superseded("new"), "superseded"), (Overloaded("full"), "overloaded")])
async def test_what_the_service_says_is_told_apart(error: Exception, fate: str) -> None:
    source = FakeFrames()
    source.error = error
    async with viewing(source) as (viewer, _):
        await eventually(lambda: fates(viewer)[fate] >= 3)
    assert not fates(viewer)["served"]


async def test_a_viewer_waits_for_so_many_frames_and_asks_for_no_more() -> None:
    source = FakeFrames()
    source.held = True
    async with viewing(source) as (viewer, _):
        await eventually(lambda: fates(viewer)["waiting"] >= 3)
        assert len(viewer.waiting()) == IN_FLIGHT
    assert len(source.requests) == IN_FLIGHT


async def test_a_viewer_that_is_thrown_out_comes_again() -> None:
    source = FakeFrames()
    async with viewing(source) as (viewer, server):
        await eventually(lambda: fates(viewer)["served"])
        source.held = True
        await eventually(viewer.waiting)
        for connection in list(server._connections):
            connection.close()
        await eventually(lambda: not viewer.is_inside)
        assert fates(viewer)["lost"]
        source.held = False
        viewer.ended.clear()
        await eventually(lambda: fates(viewer)["outside"] and fates(viewer)["served"])


async def test_a_viewer_leaves_a_service_that_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.load.viewer.IDLE_S", 0.5)
    async with viewing(FakeFrames()) as (viewer, server):
        await eventually(lambda: fates(viewer)["served"])
        for connection in list(server._connections):
            connection.abandon()
            server._connections.remove(connection)
        await eventually(lambda: not viewer.is_inside)
        viewer.ended.clear()
        await eventually(lambda: fates(viewer)["served"])
