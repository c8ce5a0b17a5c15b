"""A packager on a free port, before a render service under the test's control."""

from __future__ import annotations

import asyncio
import io
import json
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import av
import httpx
import pytest
from websockets.asyncio.client import ClientConnection, connect

from tests.dash.fakes import FakeRender
from tests.eventually import eventually
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.origins import OriginPolicy
from tigas_common.parsing import parse
from tigas_common.render_requests import RenderClient
from tigas_common.runner import serve_http
from tigas_common.wire.dash import SessionRequest
from tigas_dash.app import create_app
from tigas_dash.clock import Clock
from tigas_dash.sessions import Sessions
from tigas_dash.webrtc.stream import WebRtcServer

PATIENCE_S = 20


@dataclass
class Packager:
    """A packager, its render service, and a client of it."""

    render: FakeRender
    sessions: Sessions
    http: httpx.AsyncClient
    port: int

    async def open(self, **changes: Any) -> dict[str, Any]:
        answer = await self.http.post("/sessions", json=session_request(**changes))
        assert answer.status_code == 201, answer.text
        info: dict[str, Any] = answer.json()
        return info

    @asynccontextmanager
    async def poses(self, session: dict[str, Any]) -> AsyncIterator[ClientConnection]:
        async with connect(f"ws://127.0.0.1:{self.port}{session['poses']}", max_queue=None) as socket:
            yield socket

    async def status(self, session: dict[str, Any]) -> dict[str, Any]:
        status: dict[str, Any] = (await self.http.get(f"/sessions/{session['id']}")).json()
        return status

    async def until(self, session: dict[str, Any], condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """A session's status once it is as wanted."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                if condition(status := await self.status(session)):
                    return status
                await asyncio.sleep(0.01)

    async def until_idle(self) -> None:
        await eventually(lambda: not self.sessions.all())

    async def brightness(self, session: dict[str, Any], number: int, representation: str = "r3-500") -> dict[int, int]:
        """The grey of each frame of a segment, by the frame's number."""
        data = b""
        for name in ("init.mp4", f"{number}.m4s"):
            data += (await self.http.get(f"/sessions/{session['id']}/{representation}/{name}")).content
        with av.open(io.BytesIO(data), "r") as container:
            return {
                round(float(frame.time or 0) * 30): round(float(frame.to_ndarray()[: frame.height].mean()))
                for frame in container.decode(video=0)
            }


async def announcement(socket: ClientConnection, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first message of a pose socket that is as wanted."""
    async with asyncio.timeout(PATIENCE_S):
        while not wanted(message := json.loads(await socket.recv())):
            pass
    found: dict[str, Any] = message
    return found


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


def parsed_request(**changes: Any) -> SessionRequest:
    """The same as the service reads it."""
    return parse(SessionRequest, json.dumps(session_request(**changes)).encode())


def pose(seq: int, x: float) -> str:
    """A pose update; `x` is the brightness of the frame that it makes."""
    return json.dumps({"seq": seq, "position": [x, 0, 0], "quaternion": [0, 0, 0, 1]})


@asynccontextmanager
async def running_packager(idle_s: float = 600, limit: int = 3) -> AsyncIterator[Packager]:
    anywhere = Address("127.0.0.1", 0)
    render = FakeRender()
    transport = httpx.ASGITransport(render.app, raise_app_exceptions=False)
    async with AsyncExitStack() as stack:
        upstream = await stack.enter_async_context(httpx.AsyncClient(transport=transport, base_url="http://render"))
        client, clock = RenderClient(upstream), Clock()
        sessions = await stack.enter_async_context(Sessions(client, "libx264", clock, limit=limit, idle_s=idle_s).run())
        webrtc = await stack.enter_async_context(WebRtcServer.listen(client, anywhere, clock))
        app = create_app(sessions, OriginPolicy(), webrtc)
        port = await stack.enter_async_context(serve_http(app, anywhere, HttpLimits(), websockets=True))
        http = await stack.enter_async_context(httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=10))
        yield Packager(render, sessions, http, port)
        render.gate.set()


@pytest.fixture
async def packager() -> AsyncIterator[Packager]:
    async with running_packager() as running:
        yield running
