"""The packager as its viewers meet it: over HTTP and the pose socket, with a render service that does what it likes."""

from __future__ import annotations

import asyncio
import io
import json
import socket
import time
from collections.abc import Callable
from typing import Any

import av
import httpx
import pytest
from websockets.exceptions import ConnectionClosed

from tests.dash.boxes import contents
from tests.dash.conftest import Packager, pose, running_packager, session_request
from tests.dash.fakes import BUSY
from tigas_dash.app import create_app
from tigas_dash.encoder import Encoder
from tigas_dash.session import Session

pytestmark = pytest.mark.anyio
PATIENCE_S = 20


async def until(condition: Callable[[dict[str, Any]], bool], packager: Packager, session: dict[str, Any]) -> None:
    """Until a session's status is as wanted."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition(status := await packager.status(session)):
        assert time.monotonic() < deadline, status
        await asyncio.sleep(0.01)


async def until_idle(packager: Packager) -> None:
    """Until every stream has ended."""
    deadline = time.monotonic() + PATIENCE_S
    while packager.sessions.all():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.01)


async def told(socket_: Any, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first announcement that is as wanted."""
    async with asyncio.timeout(PATIENCE_S):
        while not wanted(message := json.loads(await socket_.recv())):
            pass
    found: dict[str, Any] = message
    return found


async def brightness(
    packager: Packager, session: dict[str, Any], number: int, representation: str = "r3-500"
) -> dict[int, int]:
    """The grey of each frame of a segment, by the frame's number."""
    base = f"/sessions/{session['id']}/{representation}"
    data = (await packager.http.get(f"{base}/init.mp4")).content + (
        await packager.http.get(f"{base}/{number}.m4s")
    ).content
    with av.open(io.BytesIO(data), "r") as container:
        return {
            round(float(frame.time or 0) * 30): round(float(frame.to_ndarray()[: frame.height].mean()))
            for frame in container.decode(video=0)
        }


async def test_a_pose_shows_in_the_stream_and_the_socket_says_in_which_frame(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        await socket_.send(pose(7, 200))
        shown = await told(socket_, lambda message: message.get("pose") == 7)
    assert shown["media_time_s"] == pytest.approx(shown["frame"] / 30)
    greys = await brightness(packager, session, shown["frame"] // 15 + 1)
    assert shown["frame"] in greys
    for number, luma in greys.items():
        assert luma == pytest.approx(200 if number >= shown["frame"] else 100, abs=4)


async def test_a_growing_segment_is_sent_chunk_by_chunk_to_every_reader(packager: Packager) -> None:
    session = await packager.open(segment_s=1)

    async def arrivals() -> list[float]:
        times = []
        path = f"/sessions/{session['id']}/r3-500/2.m4s"
        async with packager.http.stream("GET", path, headers={"origin": "http://localhost:8080"}) as answer:
            assert answer.headers["transfer-encoding"] == "chunked"
            assert answer.headers["access-control-allow-origin"] == "*"
            async for part in answer.aiter_raw():
                times += [time.monotonic()] * len(contents(part, b"moof"))
        return times

    for times in await asyncio.gather(arrivals(), arrivals()):
        assert len(times) > 20
        assert times[-1] - times[0] > 0.7, "the segment came as a whole"


async def test_media_time_is_locked_to_the_clock(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        first = json.loads(await socket_.recv())
        began = time.monotonic()
        last = await told(socket_, lambda message: message["frame"] >= first["frame"] + 60)
    assert last["media_time_s"] - first["media_time_s"] == pytest.approx(time.monotonic() - began, abs=0.3)


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


async def test_one_render_per_tick_makes_every_representation(packager: Packager) -> None:
    session = await packager.open(representations=[{"rung": 3}, {"rung": 2}, {"rung": 2, "bitrate_kbps": 900}])
    names = [(one["id"], one["width"], one["height"], one["bitrate_kbps"]) for one in session["representations"]]
    assert names == [("r2-1414", 640, 360, 1414), ("r2-900", 640, 360, 900), ("r3-500", 320, 180, 500)]
    await until(lambda status: status["frames"] >= 15, packager, session)
    assert {(one.width, one.height) for one in packager.render.requests} == {(640, 360)}
    for name, *_ in names:
        greys = await brightness(packager, session, 1, name)
        assert list(greys.values()) == pytest.approx([100] * len(greys), abs=4)
        assert greys


async def test_an_encoder_that_fails_is_replaced(packager: Packager, monkeypatch: pytest.MonkeyPatch) -> None:
    session = await packager.open()
    encode, failing = Encoder.encode, {7}

    def fail_once(self: Encoder, frame: av.VideoFrame, number: int, *, keyframe: bool) -> Any:
        if number % 15 in failing:
            failing.clear()
            raise ValueError("no")
        return encode(self, frame, number, keyframe=keyframe)

    monkeypatch.setattr(Encoder, "encode", fail_once)
    await until(lambda status: status["encoder_failures"] == 1, packager, session)
    status = await packager.status(session)
    assert await brightness(packager, session, (status["frames"] + status["dropped"]) // 15 + 1)


async def test_an_encoder_that_fails_for_good_ends_the_stream(
    packager: Packager, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:

        def fail(*_: object, **__: object) -> Any:
            raise ValueError("no")

        monkeypatch.setattr(Encoder, "encode", fail)
        with pytest.raises(ConnectionClosed) as closed:
            await told(socket_, lambda _: False)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4001
    assert (await packager.http.get(session["manifest"])).status_code == 404
    monkeypatch.undo()
    await packager.open()


@pytest.mark.parametrize(
    ("changes", "status", "kind"),
    [
        ({"scene": "nowhere"}, 404, "unknown-scene"),
        ({"scene": "../../etc/passwd"}, 404, "unknown-scene"),
        ({"frame_rate": 0}, 400, "invalid-request"),
        ({"frame_rate": 1000}, 400, "invalid-request"),
        ({"segment_s": 0}, 400, "invalid-request"),
        ({"segment_s": 1e300}, 400, "invalid-request"),
        ({"frames_per_chunk": 16}, 400, "invalid-request"),
        ({"target_latency_ms": -1}, 400, "invalid-request"),
        ({"representations": []}, 400, "invalid-request"),
        ({"representations": [{"rung": 0}] * 50}, 400, "invalid-request"),
        ({"representations": [{"rung": 3}, {"rung": 3}]}, 400, "invalid-request"),
        ({"representations": [{"rung": 3}, {"rung": 3, "bitrate_kbps": 500}]}, 400, "invalid-request"),
        ({"representations": [{"rung": 9}]}, 400, "invalid-request"),
        ({"representations": [{"rung": 3, "bitrate_kbps": 0}]}, 400, "invalid-request"),
        ({"quaternion": [0, 0, 0, 0]}, 400, "invalid-request"),
        ({"width": 100_000}, 400, "invalid-request"),
        ({"more": 1}, 400, "invalid-request"),
    ],
)
async def test_what_cannot_be_streamed_is_refused_in_a_sentence(
    packager: Packager, changes: dict[str, Any], status: int, kind: str
) -> None:
    answer = await packager.http.post("/sessions", json=session_request(**changes))
    assert (answer.status_code, answer.json()["type"]) == (status, f"tigas:{kind}"), answer.text
    assert answer.json()["detail"].endswith(".")
    assert packager.sessions.all() == []


async def test_hostile_bodies(packager: Packager) -> None:
    for content, status in ((b"", 400), (b"{", 400), (b"[]", 400), (b"\xff\xfe", 400), (b"x" * 20_000, 413)):
        assert (await packager.http.post("/sessions", content=content)).status_code == status


async def test_poses_that_cannot_be_read_are_answered_and_change_nothing(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        for text in (
            "no JSON",
            pose(1, 50).replace("50", "NaN"),
            pose(1, 50).replace("50", "1e999"),
            pose(-1, 50),
            '{"seq": 1}',
            "x" * 20_000,
        ):
            await socket_.send(text)
            assert (await told(socket_, lambda message: "type" in message))["type"].startswith("tigas:")
        assert (await packager.status(session))["poses"] == 0
        await socket_.send(pose(2, 180))
        await told(socket_, lambda message: message.get("pose") == 2)


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("r3-500/0.m4s", 404),
        ("r3-500/999.m4s", 404),
        ("r3-500/99999999999999999999.m4s", 404),
        ("r3-500/-1.m4s", 404),
        ("r3-500/1e3.m4s", 404),
        ("r3-500/²½.m4s", 404),
        ("r3-500/%2e%2e%2f1.m4s", 404),
        ("r9/1.m4s", 404),
        ("r9/init.mp4", 404),
        ("other", 404),
    ],
)
async def test_segments_that_do_not_exist(packager: Packager, path: str, status: int) -> None:
    session = await packager.open()
    answer = await packager.http.get(f"/sessions/{session['id']}/{path}")
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"


async def test_an_expired_segment_is_gone(packager: Packager, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_dash.session.WINDOW_S", 0.5)
    session = await packager.open(segment_s=0.2, frame_rate=60)
    await until(lambda status: status["frames"] > 12 * 5, packager, session)
    (one,) = session["representations"]
    assert (await packager.http.get(f"/sessions/{session['id']}/{one['id']}/1.m4s")).status_code == 410


async def test_no_more_sessions_than_may_be(packager: Packager) -> None:
    opened = [await packager.open() for _ in range(3)]
    answer = await packager.http.post("/sessions", json=session_request())
    assert (answer.status_code, answer.json()["type"]) == (503, "tigas:too-many-sessions")
    assert (await packager.http.delete(f"/sessions/{opened[0]['id']}")).status_code == 204
    assert (await packager.http.delete(f"/sessions/{opened[0]['id']}")).status_code == 404
    await packager.open()


async def test_a_stream_that_nobody_watches_ends_and_one_that_is_watched_does_not() -> None:
    async with running_packager(idle_s=0.5) as packager:
        watched, left = await packager.open(), await packager.open()
        async with packager.poses(watched):
            deadline = time.monotonic() + PATIENCE_S
            while {one.name for one in packager.sessions.all()} != {watched["id"]}:
                assert time.monotonic() < deadline
                await asyncio.sleep(0.05)
            assert (await packager.http.get(left["manifest"])).status_code == 404
        await until_idle(packager)


async def test_a_reader_that_stops_reading_holds_up_nobody(packager: Packager) -> None:
    session = await packager.open(segment_s=0.5, representations=[{"rung": 3, "bitrate_kbps": 5000}])
    stuck = socket.create_connection(("127.0.0.1", packager.port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    for number in range(1, 4):
        stuck.sendall(f"GET /sessions/{session['id']}/r3-5000/{number}.m4s HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    before = (await packager.status(session))["frames"]
    await until(lambda status: status["frames"] > before + 30, packager, session)
    assert await brightness(packager, session, 3, "r3-5000")
    stuck.close()


async def test_the_end_of_a_session_ends_its_readers_and_watchers(packager: Packager) -> None:
    session = await packager.open(segment_s=5)
    async with packager.poses(session) as socket_:

        async def read() -> bytes:
            return (await packager.http.get(f"/sessions/{session['id']}/r3-500/1.m4s")).content

        reading = asyncio.ensure_future(read())
        await until(lambda status: status["frames"] > 10, packager, session)
        await packager.http.delete(f"/sessions/{session['id']}")
        async with asyncio.timeout(PATIENCE_S):
            assert contents(await reading, b"moof")
            with pytest.raises(ConnectionClosed):
                await told(socket_, lambda _: False)


async def test_housekeeping_goes_on_though_a_stream_ended_before_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tigas_dash.sessions.HOUSEKEEPING_S", 0.01)
    run = Session.run
    ended: list[Session] = []

    async def run_and_end_the_others(self: Session) -> None:
        try:
            await run(self)
        finally:
            if not ended:
                ended.append(self)
                for other in packager.sessions.all():
                    if other is not self:
                        await packager.sessions.end(other.name)

    monkeypatch.setattr(Session, "run", run_and_end_the_others)
    async with running_packager() as packager:
        await packager.open()
        await packager.open()
        packager.sessions._idle_s = 0
        await until_idle(packager)
        await packager.open()
        await until_idle(packager)


async def test_a_client_that_left_while_its_stream_was_opened_leaves_none_behind(packager: Packager) -> None:
    body = json.dumps(session_request()).encode()
    messages = [{"type": "http.request", "body": body}, {"type": "http.disconnect"}]

    async def receive() -> Any:
        return messages.pop(0)

    async def send(_: Any) -> None:
        pass

    scope = {"type": "http", "method": "POST", "path": "/sessions", "query_string": b"", "headers": []}
    await create_app(packager.sessions)(scope, receive, send)
    assert len(packager.render.requests) == 1
    assert packager.sessions.all() == []


async def test_a_packager_without_a_render_service_says_so(packager: Packager) -> None:
    def refuse(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("Connection refused")

    async with httpx.AsyncClient(transport=httpx.MockTransport(refuse), base_url="http://render") as upstream:
        packager.sessions._client._http = upstream
        answer = await packager.http.post("/sessions", json=session_request())
    assert (answer.status_code, answer.json()["type"]) == (502, "tigas:render-unavailable")
    assert "Connection refused" in answer.json()["detail"]
