"""An overloaded server keeps its present viewers, and refuses others with a reason."""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack

import pytest

from tests.eventually import eventually
from tests.render.admission.chosen_load import ChosenLoad
from tests.render.transport.client import FakeFrames, connect, request_body
from tests.render.transport.serving import served
from tests.render.transport.test_server_limits import OTHER, refusal
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import SETTLED_S, Load
from tigas_render.transport.aioquic_ext import quic

pytestmark = pytest.mark.anyio


async def test_new_clients_are_refused_and_those_who_are_in_go_on() -> None:
    load = ChosenLoad()
    async with served(load=load) as server, connect(server.port) as viewer, connect(server.port) as idle:
        session = await viewer.connect_webtransport()
        load.is_full = True
        assert "full" in await refusal(server)
        refused = await idle.response(await idle.connect_webtransport())
        assert (refused.status, refused.headers[b"retry-after"]) == (503, b"5")
        header, body = await viewer.frame(session, request_body())
        assert (header["status"], body) == (200, b"frame")
        assert (server.connections, load.state.refused, load.viewers) == (2, 2, 1)
        load.is_full = False
        assert idle.responses[await idle.connect_webtransport()].status == 200
        assert load.viewers == 2
    assert load.viewers == 0


async def test_viewers_that_vanish_count_no_more_until_they_are_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quic, "UNRESPONSIVE_S", 0.1)
    load = Load()
    async with served(load=load) as server, connect(server.port) as gone, connect(server.port) as viewer:
        for _ in range(2):
            session = await gone.connect_webtransport()
        await viewer.connect_webtransport()
        assert load.viewers == 3
        with monkeypatch.context() as outage:
            outage.setattr(gone, "datagram_received", lambda *_: None)
            answer = gone.open_stream(session, request_body())
            outage.setattr(gone, "transmit", lambda: None)
            await eventually(lambda: load.viewers == 1)
        # the next retransmission may be many seconds away, unless another answer shows that this one was lost
        assert (await gone.response(gone.open_stream(session, request_body()))).ended
        assert (await gone.response(answer)).ended
        await eventually(lambda: load.viewers == 3)


async def test_a_server_that_ends_while_viewers_are_away_counts_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quic, "UNRESPONSIVE_S", 0.1)
    load = Load()
    async with served(load=load) as server, connect(server.port) as gone:
        session = await gone.connect_webtransport()
        with monkeypatch.context() as outage:
            outage.setattr(gone, "datagram_received", lambda *_: None)
            gone.open_stream(session, request_body())
            outage.setattr(gone, "transmit", lambda: None)  # the server would hear repetitions, and count the viewer
            await eventually(lambda: load.viewers == 0)
            await server.close()
        assert load.viewers == 0


async def test_frames_say_how_often_to_ask() -> None:
    load = ChosenLoad()
    async with served(load=load) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        for told in (12.5, None):
            load.rate = told
            header, _ = await client.frame(session, request_body())
            assert header["requests_per_s"] == told


async def test_who_asks_too_often_is_told_so_and_holds_nobody_up() -> None:
    source = FakeFrames()
    async with (
        served(source=source, most_requests_per_s=1) as server,
        connect(server.port) as eager,
        connect(server.port, source=OTHER) as polite,
    ):
        session, other = await eager.connect_webtransport(), await polite.connect_webtransport()
        streams = [eager.open_stream(session, request_body(seq=seq)) for seq in range(20)]
        assert (await polite.frame(other, request_body()))[0]["status"] == 200
        statuses = [(await eager.header(stream))["status"] for stream in streams]
        assert set(statuses) == {200, 429}
        assert statuses.count(200) < 10
        for seq in range(20):
            eager.send_datagram(session, request_body(seq=seq))
        await eager.until(lambda: any(b"asked-too-often" in datagram for datagram in eager.datagrams))
    assert len(source.requests) < 20


async def test_old_datagrams_are_not_looked_at() -> None:
    class Strict(Load):
        drops = False

        def accept_datagram(self, age: float) -> bool:
            super().accept_datagram(age)
            return not self.drops

    load = Strict()
    async with served(load=load) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        load.drops = True
        before = load._handled
        stream = client.open_stream(session, request_body())
        await eventually(lambda: load._handled > before)
        assert not client.responses[stream].done
        load.drops = False  # QUIC sends it again
        assert (await client.response(stream)).ended


async def test_a_thousand_idle_sessions_cost_nothing_and_keep_nobody_out() -> None:
    waited = 0.0
    load = Load(lambda: time.monotonic() + waited)
    limits = Limits(sessions=15, handshakes_per_s=1000, idle_timeout=300)
    async with served(limits, load=load) as server, AsyncExitStack() as stack:
        for number in range(67):
            idle = await stack.enter_async_context(connect(server.port, source=f"127.0.1.{number // 4}"))
            for _ in range(15):
                assert idle.responses[await idle.connect_webtransport()].status == 200
            waited += SETTLED_S
        assert load.viewers == 1005
        measuring = asyncio.create_task(load.run())
        await eventually(lambda: load.retry_after_s() is None)
        async with connect(server.port, source=OTHER) as other:
            header, _ = await other.frame(await other.connect_webtransport(), request_body())
            assert header["status"] == 200
        assert load.state.utilisation < 0.5
        measuring.cancel()
