"""An HTTP/3 server for tests, with helpers that wait for its effects."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator, Callable

from starlette.types import Receive, Scope, Send

from tests.render.transport.client import (
    CERTIFICATE,
    FakeFrames,
)
from tigas_render.admission.limits import Limits
from tigas_render.admission.load import Load
from tigas_render.admission.viewers import RequestRate
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server


async def hello(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": scope["path"].encode()})


@contextlib.asynccontextmanager
async def served(
    limits: Limits | None = None,
    source: FakeFrames | None = None,
    *,
    load: Load | None = None,
    most_requests_per_s: float = math.inf,
) -> AsyncIterator[Http3Server]:
    load = load or Load()
    sessions = {
        "/render": render_session(source or FakeFrames(), RequestRate(load, most_requests_per_s, time.monotonic))
    }
    async with Http3Server(
        hello, host="127.0.0.1", certificate=CERTIFICATE, webtransport=sessions, limits=limits, load=load
    ) as server:
        yield server


async def eventually(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(20):
        while not condition():  # noqa: ASYNC110 - the server's state has no event to wait for
            await asyncio.sleep(0.005)
