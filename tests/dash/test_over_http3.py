"""Segments over HTTP/3: from the packager through the render service, by the sender of frames."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from starlette.responses import Response

from tests.dash import fakes
from tests.dash.conftest import Packager
from tests.eventually import eventually
from tests.render.transport.client import Client, connect
from tests.render.transport.serving import served
from tigas_common.origins import OriginPolicy
from tigas_render.server.upstreams import Upstreams

pytestmark = pytest.mark.anyio


@asynccontextmanager
async def front(packager: Packager) -> AsyncIterator[int]:
    """The UDP port of a render service before the packager."""
    services = {"dash": f"http://127.0.0.1:{packager.port}"}
    async with (
        Upstreams.around(Response("the page"), services, OriginPolicy()) as app,  # type: ignore[arg-type]
        served(app=app) as server,
    ):
        yield server.port


def ask(client: Client, session: dict[str, Any], number: int) -> int:
    """Request a segment as the page does; its stream."""
    path = f"/services/dash/sessions/{session['id']}/{session['representations'][0]['id']}/{number}.m4s"
    return client.request("GET", path, headers=[(b"origin", b"http://localhost:8080")])


async def begun(client: Client, stream: int) -> None:
    await client.until(lambda: client.responses[stream].body)


async def test_a_growing_segment_arrives_chunk_by_chunk_and_a_page_on_another_port_sees_how(packager: Packager) -> None:
    session = await packager.open(segment_s=1)
    async with front(packager) as port, connect(port) as client:
        stream = ask(client, session, 2)
        await begun(client, stream)
        early = client.responses[stream].body.count(b"moof")
        whole = await client.response(stream)
    assert early < 10, "the segment came as a whole"
    assert whole.body.count(b"moof") > 20
    assert whole.headers[b"access-control-allow-origin"] == b"http://localhost:8080"
    assert whole.headers[b"timing-allow-origin"] == b"*"


async def test_a_reader_that_stops_holds_up_nobody(packager: Packager, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fakes, "grey", lambda width, height, _: os.urandom(width * height * 3 // 2))
    session = await packager.open(segment_s=0.5, representations=[{"rung": 3, "bitrate_kbps": 5000}])
    async with front(packager) as port, connect(port) as stuck, connect(port) as client:
        for number in (1, 2, 3):
            ask(stuck, session, number)
        await begun(stuck, 0)
        monkeypatch.setattr(stuck, "datagram_received", lambda *_: None)
        segment = await client.response(ask(client, session, 3))
        assert (segment.status, segment.body.count(b"moof")) == (200, 15)
        before = (await packager.status(session))["frames"]
        await packager.until(session, lambda status: status["frames"] > before + 30)


async def test_a_reader_that_leaves_takes_its_request_with_it(packager: Packager) -> None:
    session = await packager.open(segment_s=10)
    stream = packager.sessions.get(session["id"])
    async with front(packager) as port:
        async with connect(port) as client:
            await begun(client, ask(client, session, 1))
        sent = frames = 0

        def unread() -> bool:
            """Whether nothing was read during the last ten frames."""
            nonlocal sent, frames
            if stream.sent_bytes.total() != sent:
                sent, frames = stream.sent_bytes.total(), stream.progress.frames
            return stream.progress.frames > frames + 10

        await eventually(unread)
        assert stream.progress.frames < 300, "the request lasted until the segment's end"
