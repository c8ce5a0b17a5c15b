"""`POST /render`: viewers are told apart, and no reader holds the memory of frames."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tests.eventually import eventually
from tests.render.admission.chosen_load import ChosenLoad
from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import Edge, Engine
from tests.render.transport.client import FakeFrames
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import HttpViewers, RequestRate
from tigas_render.frame import FrameSource
from tigas_render.server.frame_route import HttpFrames, frames_app

pytestmark = pytest.mark.anyio
BODY = render_request().model_dump_json()


def serving(source: FrameSource, load: Load) -> ASGIApp:
    return frames_app(HttpFrames(source, HttpViewers(load, lambda: 0.0), RequestRate(load, 20, lambda: 0.0)))


async def test_a_full_server_keeps_a_viewer_and_refuses_its_neighbour_behind_the_same_gateway() -> None:
    load = ChosenLoad()
    transport = httpx.ASGITransport(serving(FakeFrames(), load))
    async with httpx.AsyncClient(base_url="http://localhost", transport=transport) as client:

        async def ask(viewer: str) -> httpx.Response:
            return await client.post("/render", content=BODY, headers={"Tigas-Viewer": viewer})

        assert (await ask("first")).status_code == 200
        load.is_full = True
        refused = await ask("second")
        assert (refused.status_code, refused.json()["type"], refused.headers["retry-after"]) == (503, "tigas:full", "5")
        assert ((await ask("first")).status_code, (await ask("x" * 65)).status_code) == (200, 400)
        assert {(await ask("first")).status_code for _ in range(40)} == {200, 429}, "it asks too often"


@pytest.mark.parametrize(("version", "transport"), [("1.1", "http1"), ("3", "http3")])
async def test_metrics_are_to_know_how_a_viewer_is_reached(version: str, transport: str) -> None:
    source = FakeFrames()
    frames = serving(source, ChosenLoad())

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await frames({**scope, "http_version": version}, receive, send)

    async with httpx.AsyncClient(base_url="http://localhost", transport=httpx.ASGITransport(app)) as client:
        assert (await client.post("/render", content=BODY)).status_code == 200
    assert source.requests[0][0].transport == transport


async def test_a_frame_says_that_it_is_coarse() -> None:
    transport = httpx.ASGITransport(serving(FakeFrames(), ChosenLoad()))
    async with httpx.AsyncClient(base_url="http://localhost", transport=transport) as client:
        for coarse, about in ((True, "profile=3, coarse=1"), (False, "profile=3")):
            body = render_request(coarse=coarse).model_dump_json()
            assert (await client.post("/render", content=body)).headers["tigas-frame"].endswith(about)


async def test_the_connections_of_one_browser_are_one_viewer_with_a_queue_each() -> None:
    source = FakeFrames()
    app = serving(source, ChosenLoad())
    for port, viewer in ((5001, "a"), (5002, "a"), (5003, "b"), (5004, ""), (5005, "")):
        transport = httpx.ASGITransport(app, client=("192.0.2.1", port))
        async with httpx.AsyncClient(base_url="http://localhost", transport=transport) as client:
            assert (await client.post("/render", content=BODY, headers={"Tigas-Viewer": viewer})).status_code == 200
    clients = [client for client, *_ in source.requests]
    assert len(set(clients)) == 5
    assert clients[0].viewer == clients[1].viewer
    assert len({client.viewer for client in clients}) == 4


async def test_a_slow_reader_gets_the_whole_frame_and_holds_no_memory_that_all_frames_need(tmp_path: Path) -> None:
    source = FakeFrames(bytes(range(256)) * 1200)
    engine = Engine(tmp_path / "pipe", source)
    async with engine.running() as pipes, Edge(engine.path).connected() as edge:
        frames = serving(edge, Load())

        async def app(scope: Scope, receive: Receive, send: Send) -> None:
            async def late(message: Message) -> None:
                if message["type"] == "http.response.body":
                    (link,) = pipes.edges
                    await eventually(lambda: not link.arena.used_bytes)  # the edge tells of it with its next message
                await send(message)

            await frames(scope, receive, late)

        async with httpx.AsyncClient(base_url="http://localhost", transport=httpx.ASGITransport(app)) as client:
            assert (await client.post("/render", content=BODY)).content == source.body
