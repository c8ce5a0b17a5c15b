"""An overloaded server keeps its present viewers, and refuses others with a reason."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack

import pytest
from aioquic.quic.packet import QuicErrorCode

from tests.render.admission.chosen_load import ChosenLoad
from tests.render.transport.client import Client, FakeFrames, connect, request_body
from tests.render.transport.serving import eventually, served
from tigas.http3 import split_frame
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import SETTLED_S, Load
from tigas_render.transport.aioquic_ext import quic

pytestmark = pytest.mark.anyio


async def test_new_clients_are_refused_and_those_who_are_in_go_on() -> None:
    load = ChosenLoad()
    async with served(load=load) as server, connect(server.port) as viewer:
        session = await viewer.connect_webtransport()
        load.is_full = True
        async with connect(server.port, wait=False) as newcomer:
            newcomer.transmit()
            await newcomer.until(lambda: newcomer.terminated)
            assert newcomer.terminated is not None
            assert newcomer.terminated.error_code == QuicErrorCode.CONNECTION_REFUSED
            assert "full" in newcomer.terminated.reason_phrase
        assert server.connections == 1
        header, body = await viewer.frame(session, request_body())
        assert (header["status"], body) == (200, b"frame")
        assert load.state.refused == 1
        load.is_full = False
        async with connect(server.port) as newcomer:
            assert newcomer.responses[await newcomer.connect_webtransport()].status == 200
            assert load.state.viewers == 2
    assert load.state.viewers == 0


async def test_viewers_that_vanish_count_no_more_until_they_are_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quic, "AWAY_S", 0.1)
    load = Load()
    async with served(load=load) as server, connect(server.port) as gone, connect(server.port) as viewer:
        for _ in range(2):
            session = await gone.connect_webtransport()
        await viewer.connect_webtransport()
        assert load.state.viewers == 3
        with monkeypatch.context() as outage:
            outage.setattr(gone, "datagram_received", lambda *_: None)
            answer = gone.open_stream(session, request_body())
            await eventually(lambda: load.state.viewers == 1)
        assert (await gone.response(answer)).ended
        await eventually(lambda: load.state.viewers == 3)
        with monkeypatch.context() as outage:
            outage.setattr(gone, "datagram_received", lambda *_: None)
            gone.open_stream(session, request_body())
            await eventually(lambda: load.state.viewers == 1)
            await server.close()
        assert load.state.viewers == 0


async def test_a_session_is_refused_with_the_time_to_come_back() -> None:
    load = ChosenLoad()
    async with served(load=load) as server, connect(server.port) as client:
        load.is_full = True
        refused = await client.response(await client.connect_webtransport())
        assert (refused.status, refused.headers[b"retry-after"]) == (503, b"5")
        load.is_full = False
        assert client.responses[await client.connect_webtransport()].status == 200


async def test_frames_say_how_often_to_ask() -> None:
    load = ChosenLoad()
    async with served(load=load) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        load.told = 12.5
        header, _ = await client.frame(session, request_body())
        assert header["requests_per_s"] == 12.5
        load.told = None
        header, _ = await client.frame(session, request_body())
        assert header["requests_per_s"] is None


async def ask(client: Client, session: int, times: int, per_s: float) -> list[int]:
    """The answers' statuses."""
    streams = []
    for number in range(times):
        streams.append(client.open_stream(session, request_body(seq=number)))
        await asyncio.sleep(1 / per_s)
    answers = [split_frame(bytes((await client.response(stream)).body))[0] for stream in streams]
    return [answer["status"] for answer in answers]


async def test_a_viewer_that_asks_a_thousand_times_a_second_is_told_so_and_holds_nobody_up() -> None:
    source = FakeFrames()
    async with (
        served(source=source, most_requests_per_s=100) as server,
        connect(server.port) as eager,
        connect(server.port, source="127.0.0.2") as polite,
    ):
        sessions = [await client.connect_webtransport() for client in (eager, polite)]
        began = time.monotonic()
        of_eager, of_polite = await asyncio.gather(ask(eager, sessions[0], 400, 1000), ask(polite, sessions[1], 20, 20))
        seconds = time.monotonic() - began
        assert of_polite == [200] * 20
        assert set(of_eager) == {200, 429}
        assert of_eager.count(200) <= 100 * seconds + 30
        assert sum(client.session == source.requests[0][0].session for client, _ in source.requests) < 400


async def test_a_request_too_many_by_datagram_is_told_so() -> None:
    async with served(most_requests_per_s=1) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        for seq in range(20):
            client.send_datagram(session, request_body(seq=seq))
        await client.until(lambda: any(b"asked-too-often" in datagram for datagram in client.datagrams))


async def test_old_datagrams_are_not_looked_at() -> None:
    class Strict(Load):
        def handled(self, age: float) -> bool:
            return not self.drops

        drops = False

    load = Strict()
    async with served(load=load) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        load.drops = True
        stream = client.open_stream(session, request_body())
        await asyncio.sleep(0.1)
        assert not client.responses[stream].done
        load.drops = False  # QUIC sends it again
        assert (await client.response(stream)).ended


async def test_a_stalled_loop_is_no_reason_to_refuse_anybody() -> None:
    load = Load()
    async with served(load=load) as server:
        measuring = asyncio.create_task(load.keep())
        for _ in range(3):
            await asyncio.sleep(0.15)
            time.sleep(0.4)  # noqa: ASYNC251 - what a start-up compile does
            assert load.full() is None
        async with connect(server.port) as client:
            assert client.responses[await client.connect_webtransport()].status == 200
        measuring.cancel()


async def test_a_slow_reader_holds_nobody_else_up() -> None:
    source = FakeFrames(bytes(300_000))
    async with (
        served(source=source) as server,
        connect(server.port, max_data=40_000, max_stream_data=40_000) as slow,
        connect(server.port, source="127.0.0.2") as quick,
    ):
        slow_session, session = await slow.connect_webtransport(), await quick.connect_webtransport()
        slow._quic._local_max_data.value = slow._quic._local_max_data.sent  # it never reads on
        slow._quic._write_connection_limits = lambda **_: None  # type: ignore[method-assign]
        for _ in range(6):
            slow.open_stream(slow_session, request_body())
        await source.until(lambda: len(source.requests) == 6)
        for seq in range(10):
            header, body = await quick.frame(session, request_body(seq=seq))
            assert (header["status"], len(body)) == (200, 300_000)


async def test_a_thousand_idle_sessions_cost_nothing_and_keep_nobody_out() -> None:
    waited = 0.0
    load = Load(lambda: time.monotonic() + waited)
    limits = Limits(sessions=15, handshakes_per_s=1000)
    async with served(limits, load=load) as server, AsyncExitStack() as stack:
        for number in range(67):
            idle = await stack.enter_async_context(connect(server.port, source=f"127.0.1.{number // 4}"))
            for _ in range(15):
                assert idle.responses[await idle.connect_webtransport()].status == 200
            waited += SETTLED_S
        assert load.state.viewers == 1005
        measuring = asyncio.create_task(load.keep())
        await eventually(lambda: load.full() is None)
        async with connect(server.port, source="127.0.0.2") as other:
            header, _ = await other.frame(await other.connect_webtransport(), request_body())
            assert header["status"] == 200
        assert load.state.utilisation < 0.5
        measuring.cancel()
