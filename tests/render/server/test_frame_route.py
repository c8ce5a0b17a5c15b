"""Identification of clients by `POST /render`."""

from __future__ import annotations

import httpx
import pytest
from starlette.types import Receive, Scope, Send

from tests.render.admission.chosen_load import ChosenLoad
from tests.render.fakes import render_request
from tests.render.transport.client import FakeFrames
from tigas_render.admission.viewers import HttpViewers, RequestRate
from tigas_render.server.frame_route import HttpFrames, frames_app

pytestmark = pytest.mark.anyio


async def test_a_full_server_keeps_a_viewer_and_refuses_its_neighbour_behind_the_same_gateway() -> None:
    load = ChosenLoad()
    frames = HttpFrames(FakeFrames(), HttpViewers(load, lambda: 0.0), RequestRate(load, 240, lambda: 0.0))
    transport = httpx.ASGITransport(frames_app(frames))
    async with httpx.AsyncClient(base_url="http://localhost", transport=transport) as client:

        async def ask(viewer: str) -> int:
            body = render_request().model_dump_json()
            return (await client.post("/render", content=body, headers={"Tigas-Viewer": viewer})).status_code

        assert await ask("first") == 200
        load.is_full = True
        assert (await ask("first"), await ask("second"), await ask("x" * 65)) == (200, 503, 400)


@pytest.mark.parametrize(("version", "transport"), [("1.1", "http1"), ("3", "http3")])
async def test_metrics_are_to_know_how_a_viewer_is_reached(version: str, transport: str) -> None:
    source, load = FakeFrames(), ChosenLoad()
    frames = frames_app(HttpFrames(source, HttpViewers(load, lambda: 0.0), RequestRate(load, 240, lambda: 0.0)))

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await frames({**scope, "http_version": version}, receive, send)

    async with httpx.AsyncClient(base_url="http://localhost", transport=httpx.ASGITransport(app)) as client:
        assert (await client.post("/render", content=render_request().model_dump_json())).status_code == 200
    assert source.requests[0][0].transport == transport
