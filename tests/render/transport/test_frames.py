"""The render session over streams, as docs/protocol.md has it."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import logging
import random
import time

import pytest

from tests.eventually import eventually
from tests.render.transport.client import FakeFrames, connect, request_body
from tests.render.transport.serving import in_datagrams, in_session
from tigas.http3 import split_frame
from tigas_common.errors import UnknownScene
from tigas_common.wire.render import RenderRequest, VideoInfo
from tigas_render.admission.limits import Limits
from tigas_render.frame import Cancel, Frame, OnAnswer
from tigas_render.frame import Client as FrameClient

pytestmark = pytest.mark.anyio


async def test_a_frame_on_a_stream() -> None:
    source = FakeFrames(random.Random(1).randbytes(200_000))
    async with in_session(source) as (_, client, session):
        response = client.responses[session]
        assert response.status == 200
        assert response.headers[b"sec-webtransport-http3-draft"] == b"draft02"
        header, body = await client.frame(session, request_body(seq=7, profile=2))
        margins, _ = await client.frame(session, request_body(overscan=0.1))
        coarse, _ = await client.frame(session, request_body(coarse=True))
        assert not client.terminated
    assert header == {
        "status": 200,
        "seq": 7,
        "content_type": "image/jpeg",
        "width": 320,
        "height": 180,
        "margin_x": None,
        "margin_y": None,
        "profile": 2,
        "coarse": None,
        "video": None,
        "timing": {"queue": 1.0, "render": 2.0, "encode": 3.0},
        "requests_per_s": None,
    }
    assert [margins[name] for name in ("width", "height", "margin_x", "margin_y")] == [384, 216, 32, 18]
    assert coarse["coarse"] is True
    assert body == source.body
    assert source.requests[0][0].transport == "webtransport"


@pytest.mark.parametrize("by", ["stream", "datagram"])
async def test_a_request_arrives_when_the_kernel_gets_the_datagram_that_completes_it(by: str) -> None:
    source = FakeFrames()
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body()[:5], end=False) if by == "stream" else None
        await client.ping()
        before = time.monotonic()
        if stream is None:
            client.send_datagram(session, request_body())
        else:
            client.send(stream, request_body()[5:], end=True)
        sent = time.monotonic()  # and the server has not had its turn yet
        await eventually(lambda: source.arrivals)
    assert before <= source.arrivals[0] <= sent


async def test_each_session_is_a_client_of_its_own() -> None:
    source = FakeFrames()
    async with in_session(source) as (server, client, session), connect(server.port) as other:
        second, third = await client.connect_webtransport(), await other.connect_webtransport()
        for connection, its_session in ((client, session), (client, session), (client, second), (other, third)):
            await connection.frame(its_session, request_body())
    clients = [client for client, _ in source.requests]
    assert clients[0] == clients[1]
    assert len(set(clients)) == 3
    assert {client.address for client in clients} == {"127.0.0.1"}


@pytest.mark.parametrize(
    ("body", "seq"),
    [
        (b"", 0),
        (b"not json", 0),
        (b"[]", 0),
        (b'"' + b"[" * 5000, 0),
        (b"[" * 15_000, 0),
        (b"\xff\xfe\x00", 0),
        (request_body(seq=5, fx=-1), 5),
        (request_body(seq=-1), 0),
        (request_body(seq=2**40), 0),
        (request_body(seq=True), 0),
    ],
)
async def test_a_bad_request_is_a_problem_with_one_sentence(body: bytes, seq: int) -> None:
    source = FakeFrames()
    async with in_session(source) as (_, client, session):
        header, problem = await client.frame(session, body)
        assert (header["status"], header["seq"], header["content_type"]) == (400, seq, "application/problem+json")
        assert json.loads(problem)["type"] == "tigas:invalid-request"
        assert (await client.frame(session, request_body()))[0]["status"] == 200
    assert len(source.requests) == 1


async def test_the_engines_errors_are_problems_and_unexpected_ones_tell_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    source = FakeFrames()
    async with in_session(source) as (_, client, session):
        source.error = UnknownScene("There is no scene 'x'.")
        header, problem = await client.frame(session, request_body(seq=3))
        assert (header["status"], header["seq"]) == (404, 3)
        assert json.loads(problem)["detail"] == "There is no scene 'x'."
        source.error = RuntimeError("secret")
        with caplog.at_level(logging.ERROR, "tigas_render"):
            header, problem = await client.frame(session, request_body())
    assert header["status"] == 500
    assert b"secret" not in problem
    assert "secret" in caplog.text


@pytest.mark.parametrize(("size", "status"), [(20_000, 413), (1, 400)], ids=["over the limit", "never finished"])
async def test_a_body_that_is_too_large_or_too_slow_is_cut(size: int, status: int) -> None:
    source = FakeFrames()
    async with in_session(source, Limits(request_timeout=0.05)) as (_, client, session):
        stream = client.open_stream(session, b" " * size, end=False)
        assert (await client.header(stream))["status"] == status
        await client.until(lambda: client.responses[stream].stopped is not None)
        assert (await client.frame(session, request_body()))[0]["status"] == 200
    assert len(source.requests) == 1


@pytest.mark.parametrize("how", ["stop", "close session", "close connection"])
async def test_what_the_client_does_not_want_any_more_is_withdrawn(how: str) -> None:
    source = FakeFrames()
    source.held = {1}
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body(seq=1))
        await eventually(lambda: source.requests)
        if how == "stop":
            client.stop(stream)
            assert (await client.frame(session, request_body(seq=2)))[0]["seq"] == 2
        elif how == "close session":
            client.send(session, bytes.fromhex("000768430400000000"), end=True)
        else:
            client.close()
        await eventually(lambda: source.cancelled == [1])


async def test_a_request_that_is_reset_before_its_end_does_not_reach_the_engine() -> None:
    source = FakeFrames()
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body(seq=1), end=False)
        client._quic.reset_stream(stream, 0)
        client.transmit()
        await client.response(stream)
    assert source.requests == []


async def test_a_frame_cancelled_while_it_is_being_sent_makes_room_for_the_next() -> None:
    source = FakeFrames(bytes(3_000_000))
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body(seq=1))
        await client.until(lambda: len(client.responses[stream].body) > 20_000)
        client.stop(stream)
        source.body = b"next"
        header, body = await client.frame(session, request_body(seq=2))
        assert (header["seq"], body) == (2, b"next")
        response = await client.response(stream)
        assert response.reset is not None
        assert len(response.body) < 3_000_000


VIDEO = {"format": "h264", "video": {"bitrate_kbps": 1000}}


async def test_a_view_that_waits_for_the_network_makes_way_for_a_newer_one() -> None:
    """The first frame fills the congestion window of a new connection."""
    source = FakeFrames(random.Random(1).randbytes(100_000))
    source.held = True
    asked = [
        request_body(seq=1),
        request_body(seq=2),
        request_body(seq=4),
        request_body(seq=3),
        request_body(seq=5, fx=1.0),
        request_body(seq=6, format="h264", video={"bitrate_kbps": 1000}),
        request_body(fx=2.0),
        request_body(fx=2.0),
    ]
    async with in_session(source) as (_, client, session):
        answers = asyncio.gather(*(client.frame(session, body) for body in asked))
        await source.until(lambda: len(source.requests) == len(asked))
        for seq in (1, 2, 4, 3, 5, 6, 0):
            source.release(seq)
        found = [(header["seq"], header["status"]) for header, _ in await answers]
        assert found == [(1, 200), (2, 409), (4, 200), (3, 409), (5, 200), (6, 200), (0, 200), (0, 200)]
    assert source.cancelled == []


async def test_a_frame_of_a_video_says_what_it_refers_to_and_needs_a_stream() -> None:
    source = FakeFrames(b"access unit")
    source.video = VideoInfo(key=False, after=6, codec="avc1.4d401f")
    async with in_session(source) as (_, client, session):
        header, body = await client.frame(session, request_body(seq=7, **VIDEO))
        assert (header["content_type"], body) == ("video/h264", b"access unit")
        assert header["video"] == {"key": False, "after": 6, "codec": "avc1.4d401f"}
        client.send_datagram(session, request_body(seq=4, **VIDEO))
        header, problem = split_frame(await in_datagrams(client, 4))
    assert header["status"] == 400
    assert "needs a stream" in json.loads(problem)["detail"]
    assert len(source.requests) == 1


@pytest.mark.parametrize("size", [3_000_000, 30_000], ids=["partly sent", "with QUIC"])
async def test_a_video_begins_anew_after_a_frame_that_its_viewer_does_not_read(size: int) -> None:
    source = FakeFrames(bytes(size))
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body(seq=1, **VIDEO))
        await client.until(lambda: len(client.responses[stream].body) > 1_000)
        client.stop(stream)
        await eventually(lambda: source.forgotten)
    assert source.forgotten[0] == source.requests[0][0]


async def test_only_the_end_of_its_session_ends_a_video_whose_frames_are_read() -> None:
    source = FakeFrames()
    source.held = {1}
    async with in_session(source) as (_, client, session):
        still = client.open_stream(session, request_body(seq=1))
        await eventually(lambda: source.requests)
        client.stop(still)
        await eventually(lambda: source.cancelled)
        for seq in (2, 3):
            await client.frame(session, request_body(seq=seq, **VIDEO))
        assert source.forgotten == []
        client.close()
        await eventually(lambda: source.forgotten)
    assert source.forgotten == [source.requests[0][0]]


async def test_unknown_paths_and_too_many_sessions_are_refused() -> None:
    async with in_session(FakeFrames(), Limits(sessions=2)) as (_, client, first):
        for path, status in (("/other", 404), ("/render?x=1", 200), ("/render", 429)):
            assert client.responses[await client.connect_webtransport(path)].status == status
        await client.end(first)
        assert client.responses[await client.connect_webtransport()].status == 200


async def test_streams_of_no_session_and_unidirectional_ones_are_refused() -> None:
    source = FakeFrames()
    async with in_session(source) as (_, client, session):
        stray = client.open_stream(4 * 1000, request_body())
        assert (await client.response(stray)).reset is not None
        one_way = client.h3.create_webtransport_stream(session, is_unidirectional=True)
        client.send(one_way, request_body())
        await client.until(lambda: client.responses[one_way].stopped is not None)
        assert (await client.frame(session, request_body()))[0]["status"] == 200
    assert len(source.requests) == 1


class LentFrames(FakeFrames):
    """Frames in memory that is overwritten on release."""

    lent = 0

    def request(self, client: FrameClient, request: RenderRequest, arrived: float, on_answer: OnAnswer) -> Cancel:
        def lend(answer: Frame | Exception) -> None:
            assert isinstance(answer, Frame)
            memory = bytearray(answer.body)
            self.lent += 1
            on_answer(dataclasses.replace(answer, body=memoryview(memory), on_release=lambda: give_back(memory)))

        def give_back(memory: bytearray) -> None:
            memory[:] = bytes(len(memory))
            self.lent -= 1

        return super().request(client, request, arrived, lend)


async def test_a_frame_is_given_back_at_once_and_arrives_whole() -> None:
    source = LentFrames(random.Random(3).randbytes(1_500_000))  # more than a connection's answers may hold in QUIC
    async with in_session(source) as (_, client, session):
        stream = client.open_stream(session, request_body())
        await client.until(lambda: client.responses[stream].body)
        assert source.lent == 0
        _, body = split_frame(bytes((await client.response(stream)).body))
        client.send_datagram(session, request_body())
        await client.until(lambda: client.datagrams)
    assert body == source.body
    assert source.lent == 0


@pytest.mark.parametrize("limit", ["max_stream_data", "max_data"])
async def test_a_client_that_reads_no_frame_holds_none_and_nobody_up(
    limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = LentFrames(bytes(1_500_000))
    async with (
        in_session(source, Limits(stall_timeout=1)) as (server, client, session),
        connect(server.port, **{limit: 50_000}) as deaf,  # type: ignore[arg-type]  # aioquic's
    ):
        for name in ("_write_stream_limits", "_write_connection_limits"):
            monkeypatch.setattr(deaf._quic, name, lambda **_: None)
        stream = deaf.open_stream(await deaf.connect_webtransport(), request_body())
        await deaf.until(lambda: len(deaf.responses[stream].body) > 45_000)
        assert source.lent == 0
        for _ in range(3):
            assert (await client.frame(session, request_body()))[1] == source.body, "others go on"
        assert (await deaf.response(stream)).reset is not None
        assert deaf.terminated is None
