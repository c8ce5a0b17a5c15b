"""The packager from a viewer's point of view: HTTP and the pose socket, with an unreliable render service."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from typing import Any
from unittest.mock import Mock

import httpx
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import CloseCode
from websockets.typing import Origin

from tests.dash.boxes import contents
from tests.dash.conftest import Packager, announcement, pose, session_request
from tests.visitor import Visitor
from tigas_common.origins import OriginPolicy
from tigas_dash.app import create_app
from tigas_dash.webrtc.stream import WebRtcServer

pytestmark = pytest.mark.anyio


async def test_a_pose_shows_in_the_stream_and_the_socket_says_in_which_frame(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        await socket_.send(pose(7, 200))
        shown = await announcement(socket_, lambda message: message.get("pose") == 7)
    assert shown["media_time_s"] == pytest.approx(shown["frame"] / 30)
    greys = await packager.brightness(session, shown["frame"] // 15 + 1)
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
            assert answer.headers["access-control-allow-origin"] == "http://localhost:8080"
            async for part in answer.aiter_raw():
                times += [time.monotonic()] * len(contents(part, b"moof"))
        return times

    for times in await asyncio.gather(arrivals(), arrivals()):
        assert len(times) > 20
        assert times[-1] - times[0] > 0.3, "the segment came as a whole"


async def test_a_message_longer_than_any_pose_is_refused_by_its_first_bytes(packager: Packager) -> None:
    session = await packager.open()
    async with packager.poses(session) as socket_:
        text, masked_and_64_bits, mask = b"\x81", b"\xff", bytes(4)
        socket_.transport.write(text + masked_and_64_bits + (15_000_000).to_bytes(8) + mask)
        with pytest.raises(ConnectionClosed):
            await asyncio.wait_for(announcement(socket_, lambda _: False), 5)
    assert socket_.close_code == CloseCode.MESSAGE_TOO_BIG


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
        ({"width": 16, "height": 16, "fy": 500_000}, 400, "invalid-request"),
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
            b"\x00\xff",
        ):
            await socket_.send(text)
            assert (await announcement(socket_, lambda message: "type" in message))["type"].startswith("tigas:")
        assert (await packager.status(session))["poses"] == 0
        await socket_.send(pose(2, 180))
        await announcement(socket_, lambda message: message.get("pose") == 2)


async def test_segments_that_do_not_exist(packager: Packager) -> None:
    session = await packager.open()
    for path in (
        "r3-500/0.m4s", "r3-500/999.m4s", "r3-500/99999999999999999999.m4s", "r3-500/-1.m4s", "r3-500/1e3.m4s",
        "r3-500/²½.m4s", "r3-500/%2e%2e%2f1.m4s", "r9/1.m4s", "r9/init.mp4", "other",
    ):  # fmt: skip
        answer = await packager.http.get(f"/sessions/{session['id']}/{path}")
        assert answer.status_code == 404, path
        assert answer.headers["content-type"] == "application/problem+json"


async def test_a_reader_that_stops_reading_holds_up_nobody(packager: Packager) -> None:
    session = await packager.open(segment_s=0.5, representations=[{"rung": 3, "bitrate_kbps": 5000}])
    stuck = socket.create_connection(("127.0.0.1", packager.port))
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    for number in range(1, 4):
        stuck.sendall(
            f"GET /sessions/{session['id']}/r3-5000/{number}.m4s HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
        )
    before = (await packager.status(session))["frames"]
    await packager.until(session, lambda status: status["frames"] > before + 30)
    assert await packager.brightness(session, 3, "r3-5000")
    stuck.close()


async def test_a_client_that_left_while_its_stream_was_opened_leaves_none_behind(packager: Packager) -> None:
    app = create_app(packager.sessions, OriginPolicy(), Mock(spec=WebRtcServer))
    visitor = Visitor(app, "POST", "/sessions", body=json.dumps(session_request()).encode())
    visitor.left.set()
    await visitor.asking
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


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("localhost", "https://evil.example", 403),
        ("localhost", "null", 403),
        ("evil.example", "http://evil.example", 421),
    ],
)
async def test_a_foreign_page_does_not_turn_a_viewers_camera(
    packager: Packager, host: str, origin: Origin, status: int
) -> None:
    session = await packager.open()
    with pytest.raises(InvalidStatus) as refused:
        await connect(f"ws://{host}{session['poses']}", origin=origin, host="127.0.0.1", port=packager.port)
    answer = refused.value.response
    assert answer.status_code == status
    assert json.loads(answer.body)["detail"].endswith(".")
    assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
