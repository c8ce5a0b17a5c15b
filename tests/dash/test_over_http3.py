"""Segments over HTTP/3: from the packager through the render service, by the sender of frames."""

from __future__ import annotations

import pytest
from starlette.responses import Response

from tests.dash.conftest import Packager
from tests.render.transport.client import connect
from tests.render.transport.serving import served
from tigas_common.origins import OriginPolicy
from tigas_render.server.upstreams import UpstreamProxy

pytestmark = pytest.mark.anyio


async def test_a_growing_segment_arrives_chunk_by_chunk_and_a_page_on_another_port_sees_how(packager: Packager) -> None:
    session = await packager.open(segment_s=1)
    path = f"/services/dash/sessions/{session['id']}/{session['representations'][0]['id']}/2.m4s"
    services = {"dash": f"http://127.0.0.1:{packager.port}"}
    async with (
        UpstreamProxy.open(Response("the page"), services, OriginPolicy()) as app,  # type: ignore[arg-type]
        served(app=app) as server,
        connect(server.port) as client,
    ):
        stream = client.request("GET", path, headers=[(b"origin", b"http://localhost:8080")])
        await client.until(lambda: client.responses[stream].body)
        early = client.responses[stream].body.count(b"moof")
        whole = await client.response(stream)
    assert early < 20, "the segment came as a whole"
    assert whole.body.count(b"moof") > 20
    assert whole.headers[b"access-control-allow-origin"] == b"http://localhost:8080"
    assert whole.headers[b"timing-allow-origin"] == b"*"
