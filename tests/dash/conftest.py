"""A packager on a free port, before a render service under the test's control."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import httpx
import pytest
from websockets.asyncio.client import ClientConnection, connect

from tests.dash.fakes import FakeRender
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_http
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.sessions import Sessions
from tigas_dash.source import RenderClient
from tigas_dash.webrtc.service import WebRtc

IDLE_S = 600.0


@dataclass
class Packager:
    """A packager, its render service, and a client of it."""

    render: FakeRender
    sessions: Sessions
    http: httpx.AsyncClient
    port: int

    async def open(self, **changes: Any) -> dict[str, Any]:
        """A new session's SessionInfo."""
        answer = await self.http.post("/sessions", json=session_request(**changes))
        assert answer.status_code == 201, answer.text
        info: dict[str, Any] = answer.json()
        return info

    @asynccontextmanager
    async def poses(self, session: dict[str, Any]) -> AsyncIterator[ClientConnection]:
        """A session's pose socket."""
        async with connect(f"ws://127.0.0.1:{self.port}{session['poses']}", max_queue=None) as socket:
            yield socket

    async def status(self, session: dict[str, Any]) -> dict[str, Any]:
        """How a session does."""
        status: dict[str, Any] = (await self.http.get(f"/sessions/{session['id']}")).json()
        return status


def session_request(**changes: Any) -> dict[str, Any]:
    """A valid request for a small stream, with changes."""
    return {
        "scene": "scene",
        "position": [100, 0, 0],
        "quaternion": [0, 0, 0, 1],
        "fx": 160, "fy": 160, "cx": 160, "cy": 90, "width": 320, "height": 180,
        "representations": [{"rung": 3}],
        "segment_s": 0.5,
        **changes,
    }  # fmt: skip


def pose(seq: int, x: float) -> str:
    """A pose update; `x` is the brightness of the frame that it makes."""
    return json.dumps({"seq": seq, "position": [x, 0, 0], "quaternion": [0, 0, 0, 1]})


@asynccontextmanager
async def running_packager(idle_s: float = IDLE_S, limit: int = 3) -> AsyncIterator[Packager]:
    """A packager, as a context manager."""
    anywhere = Address("127.0.0.1", 0)
    render = FakeRender()
    transport = httpx.ASGITransport(render.app, raise_app_exceptions=False)
    async with AsyncExitStack() as stack:
        upstream = await stack.enter_async_context(httpx.AsyncClient(transport=transport, base_url="http://render"))
        client, clock = RenderClient(upstream), Clock()
        sessions = await stack.enter_async_context(
            Sessions(client, "libx264", clock, limit=limit, idle_s=idle_s).running()
        )
        webrtc = await stack.enter_async_context(WebRtc.running(client, anywhere, clock))
        app = create_app(sessions, OriginPolicy(), webrtc)
        port = await stack.enter_async_context(serve_http(app, anywhere, HttpLimits(), websockets=True))
        http = await stack.enter_async_context(httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=10))
        yield Packager(render, sessions, http, port)
        render.gate.set()


@pytest.fixture
async def packager() -> AsyncIterator[Packager]:
    async with running_packager() as running:
        yield running
