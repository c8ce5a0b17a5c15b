"""Sessions are bounded, time out when idle, and end in order."""

from __future__ import annotations

import asyncio

import pytest
from websockets.exceptions import ConnectionClosed

from tests.dash.boxes import contents
from tests.dash.conftest import PATIENCE_S, Packager, announcement, running_packager, session_request
from tests.eventually import eventually
from tests.prometheus import figures
from tigas_common.wire.render import Rung
from tigas_dash.session import DashStream

pytestmark = pytest.mark.anyio


async def test_no_more_sessions_than_may_be(packager: Packager) -> None:
    opened = [await packager.open() for _ in range(3)]
    answer = await packager.http.post("/sessions", json=session_request())
    assert (answer.status_code, answer.json()["type"]) == (503, "tigas:too-many-sessions")
    assert (await packager.http.delete(f"/sessions/{opened[0]['id']}")).status_code == 204
    assert (await packager.http.delete(f"/sessions/{opened[0]['id']}")).status_code == 404
    await packager.open()


async def test_representations_are_rungs_of_the_scenes_own_ladder(packager: Packager) -> None:
    packager.render.ladder = (
        Rung(name="Large", width=320, height=180, quality=80, expected_kb=9),
        Rung(name="Small", width=160, height=90, quality=80, expected_kb=3),
    )
    session = await packager.open(representations=[{"rung": 1, "bitrate_kbps": 300}])
    assert [(one["id"], one["width"]) for one in session["representations"]] == [("r1-300", 160)]
    answer = await packager.http.post("/sessions", json=session_request(representations=[{"rung": 2}]))
    assert "no rung 2, only 0 to 1" in answer.json()["detail"]


@pytest.mark.slow
async def test_a_stream_that_nobody_watches_ends_and_one_that_is_watched_does_not() -> None:
    async with running_packager(idle_s=0.5) as packager:
        watched, left = await packager.open(), await packager.open()
        async with packager.poses(watched):
            await eventually(lambda: {one.name for one in packager.sessions.all()} == {watched["id"]})
            assert (await packager.http.get(left["manifest"])).status_code == 404
        await packager.until_idle()


@pytest.mark.slow
async def test_a_stream_goes_on_while_a_segment_is_read() -> None:
    async with running_packager(idle_s=0.5) as packager:
        session = await packager.open(segment_s=3)
        async with packager.http.stream("GET", f"/sessions/{session['id']}/r3-500/1.m4s") as answer:
            content = await answer.aread()
        assert len(contents(content, b"moof")) == 3 * 30 / session["frames_per_chunk"]


async def test_metrics_count_what_streams_do_and_forget_nothing_when_they_end(packager: Packager) -> None:
    session = await packager.open(representations=[{"rung": 3}, {"rung": 2}])
    path = f"/sessions/{session['id']}/{session['representations'][-1]['id']}/1.m4s"
    segment = (await packager.http.get(path)).content
    running = await figures(packager.http)
    assert running("tigas_dash_sessions", transport="dash") == 1
    assert 0 <= running("tigas_dash_behind_seconds") < PATIENCE_S
    await packager.http.delete(f"/sessions/{session['id']}")
    await packager.until_idle()
    ended = await figures(packager.http)
    labels = {"scene": "scene", "rung": "3", "transport": "dash"}
    assert ended("tigas_dash_sent_bytes_total", **labels) == len(segment)
    assert ended("tigas_dash_sent_bytes_total") == len(segment), "nobody asked for rung 2"
    assert ended("tigas_dash_frames_total", **labels) >= running("tigas_dash_frames_total", **labels) >= 15
    assert ended("tigas_dash_frames_total") == 2 * ended("tigas_dash_frames_total", **labels)
    assert ended("tigas_dash_sessions") == 0
    await packager.open()
    assert (await figures(packager.http))("tigas_dash_frames_total") >= ended("tigas_dash_frames_total")


async def test_the_end_of_a_session_ends_its_readers_and_watchers(packager: Packager) -> None:
    session = await packager.open(segment_s=5)
    async with packager.poses(session) as socket_:

        async def read() -> bytes:
            return (await packager.http.get(f"/sessions/{session['id']}/r3-500/1.m4s")).content

        reading = asyncio.ensure_future(read())
        await packager.until(session, lambda status: status["frames"] > 10)
        await packager.http.delete(f"/sessions/{session['id']}")
        async with asyncio.timeout(PATIENCE_S):
            assert contents(await reading, b"moof")
            with pytest.raises(ConnectionClosed):
                await announcement(socket_, lambda _: False)


async def test_housekeeping_goes_on_though_a_stream_ended_before_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_dash.sessions.HOUSEKEEPING_S", 0.01)
    run = DashStream.run
    ended: list[DashStream] = []

    async def run_and_end_the_others(self: DashStream) -> None:
        try:
            await run(self)
        finally:
            if not ended:
                ended.append(self)
                for other in packager.sessions.all():
                    if other is not self:
                        await packager.sessions.end(other.name)

    monkeypatch.setattr(DashStream, "run", run_and_end_the_others)
    async with running_packager() as packager:
        await packager.open()
        await packager.open()
        packager.sessions._idle_s = 0
        await packager.until_idle()
        await packager.open()
        await packager.until_idle()
