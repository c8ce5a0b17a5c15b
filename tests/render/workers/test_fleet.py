"""Viewers of a service of several processes: connections that move, processes that are killed."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Iterator

import httpx
import pytest
from aioquic.tls import SessionTicket

from tests.eventually import eventually
from tests.render.transport.client import connect
from tests.render.workers.fleet import ASK, Fleet, Viewer, gap, serving, session, status, watching

pytestmark = [pytest.mark.anyio, pytest.mark.slow]
BACK_S = 2.0
"""Viewers see frames again within this many seconds."""


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    with serving() as running:
        yield running


async def test_a_connection_outlives_new_addresses_and_ids_and_another_edges_end(fleet: Fleet) -> None:
    loop = asyncio.get_running_loop()
    async with session(fleet) as (client, opened):
        owner = fleet.owner(client)
        other = f"edge {(owner + 1) % fleet.edges}"
        killed = fleet.child(other)
        for change in range(4):
            if change == 2:
                killed.kill()
            if change % 2:
                client.change_connection_id()
            before = client.address
            old = client._transport
            await loop.create_datagram_endpoint(lambda: client, local_addr=("127.0.0.1", 0))
            assert client.address != before
            assert old is not None
            old.close()
            assert await status(client, opened) == 200
            assert fleet.owner(client) == owner
        assert client.terminated is None
        await fleet.started_again(other, killed.pid)


@pytest.mark.alone  # a busy engine refuses frames of anybody
async def test_an_edge_that_is_killed_costs_its_own_viewers_two_seconds_and_others_nothing(fleet: Fleet) -> None:
    viewers = [Viewer(fleet) for _ in range(6)]
    async with watching(viewers):
        victim = viewers[0].owner
        hit = [viewer for viewer in viewers if viewer.owner == victim]
        spared = [viewer for viewer in viewers if viewer.owner != victim]
        assert spared
        await eventually(lambda: fleet.pid("spare edge"))
        spare = fleet.pid("spare edge")
        fleet.child(f"edge {victim}").kill()
        killed_at = time.monotonic()
        await eventually(lambda: all(viewer.connections > 1 and viewer.shown[-1] > viewer.since for viewer in hit))
        back = max(next(at for at in viewer.shown if at > viewer.since) for viewer in hit) - killed_at
        assert back < BACK_S
        assert fleet.pid(f"edge {victim}") == spare
        assert [(viewer.connections, viewer.failed) for viewer in spared] == [(1, [])] * len(spared)
        assert gap(spared, killed_at) < 1.0


async def test_while_the_engine_is_gone_edges_say_when_to_come_back_and_viewers_stay(fleet: Fleet) -> None:
    async with session(fleet) as (client, opened), httpx.AsyncClient(base_url=fleet.url) as http:
        assert await status(client, opened) == 200
        engine = fleet.child("engine")
        engine.send_signal(signal.SIGKILL)

        async def gone() -> bool:
            return (await http.get("/config.json")).status_code != 200

        await eventually(gone)
        answer = await http.get("/config.json")
        assert answer.status_code == 503
        assert int(answer.headers["retry-after"]) >= 1
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert await status(client, opened) == 503
        posted = await http.post("/render", content=ASK)
        assert (posted.status_code, "retry-after" in posted.headers) == (503, True)

        async def back() -> bool:
            return await status(client, opened) == 200 and not await gone()

        await eventually(back)
        assert client.terminated is None


async def test_early_data_is_taken_by_another_edge_than_gave_the_ticket_and_once(fleet: Fleet) -> None:
    tickets: list[SessionTicket] = []

    async def resumed_elsewhere() -> bool:
        """It may come to the edge that gave the ticket, be faster than the news of it, or be sent to an emptier edge:
        aioquic's client does not repeat early data after a Retry.
        """
        tickets.clear()
        with contextlib.suppress(ConnectionError, TimeoutError):  # new viewers are refused if they are many
            async with asyncio.timeout(2), connect(fleet.port, certificate=None, on_ticket=tickets.append) as client:
                await client.until(lambda: tickets)
                giver = fleet.owner(client)
            async with (
                asyncio.timeout(2),
                connect(fleet.port, certificate=None, ticket=tickets[0], wait=False) as early,
            ):
                asked = early.request("POST", "/render", ASK)
                await early.until(lambda: early.handshake or early.terminated)
                if early.handshake and early.handshake.early_data_accepted and fleet.owner(early) != giver:
                    return (await early.response(asked)).status == 200
        return False

    await eventually(resumed_elsewhere)
    async with connect(fleet.port, certificate=None, ticket=tickets[0], wait=False) as replayed:
        replayed.request("POST", "/render", ASK)
        await replayed.until(lambda: replayed.handshake or replayed.terminated)
        assert replayed.handshake is None or not replayed.handshake.early_data_accepted
