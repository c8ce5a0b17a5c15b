"""The HTTP/3 connection beneath the client, against the real server."""

from __future__ import annotations

import asyncio

import pytest

from tests.render.transport.client import FakeFrames, connect, request_body
from tests.render.transport.serving import served

pytestmark = pytest.mark.anyio


async def test_a_frame_that_is_cancelled_while_it_arrives_leaves_the_others_alone() -> None:
    async with served(source=FakeFrames(bytes(2_000_000))) as server, connect(server.port) as client:
        session = await client.connect_webtransport()
        task = asyncio.create_task(client.frame(session, request_body()))
        await client.until(lambda: any(response.body for response in client.responses.values()))
        task.cancel()
        for seq in range(2, 4):
            header, body = await client.frame(session, request_body(seq=seq))
            assert (header["status"], len(body)) == (200, 2_000_000)
        assert set(client.responses) == {session}
