"""A shaper without a link: it speaks the real one's protocol, records its requests, and shapes nothing."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import AsyncIterator
from typing import Any, Self

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from tigas_common.parsing import parse
from tigas_common.web import EXCEPTION_HANDLERS, json_response
from tigas_common.wire.shaper import (
    DirectionStatus,
    LinkSetting,
    LoopRequest,
    SeekRequest,
    ShaperStatus,
    StartRequest,
    TraceList,
)
from tigas_shaper.player import Player
from tigas_shaper.service import Shaper
from tigas_shaper.traces.library import TraceLibrary, UnknownTrace, summarise, trace_outline
from tigas_shaper.traces.trace import NetworkTrace

TRACES = {
    trace.name: trace
    for trace in (
        NetworkTrace("stairs", (0, 10_000, 20_000), tuple(LinkSetting(kbps, 4000) for kbps in (8e3, 2e4, 4e3)), 30_000),
        NetworkTrace("tunnel", (0, 5000), (LinkSetting(12e3, 4000), LinkSetting(0, 0)), 8000),
    )
}
IDLE = LinkSetting(down_kbps=100_000, up_kbps=50_000)
EVERY_S = 0.2


class _NoLink:
    """Without traffic."""

    backend = "netem"
    closed_reason = None

    def apply(self, state: LinkSetting, mean_kbps: tuple[float, float] | None = None) -> None:
        """Without clients."""


class FakeShaper:
    """Serves in a thread; a context manager."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []
        link = _NoLink()
        self._player = Player(link, IDLE, clock=time.monotonic)
        self._shaper = Shaper(link, None, self._player, TraceLibrary(None))  # type: ignore[arg-type]
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        changes = ("start", "stop", "pause", "resume", "seek", "loop", "link")
        app = Starlette(
            routes=[
                Route("/traces", self._traces),
                Route("/traces/{name}", self._trace),
                Route("/events", self._events),
                Route("/healthz", lambda _: Response()),
                *(Route(f"/{change}", self._change, methods=["POST"]) for change in changes),
            ],
            middleware=[Middleware(CORSMiddleware, allow_origins=["*"], allow_methods=["*"], allow_headers=["*"])],
            exception_handlers=EXCEPTION_HANDLERS,
        )
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1))
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._socket]})

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Go away, as a shaper that is stopped."""
        self._server.should_exit = True
        self._thread.join(timeout=10)
        self._socket.close()

    async def _traces(self, request: Request) -> Response:
        return json_response(TraceList(traces=tuple(summarise(trace, uploaded=False) for trace in TRACES.values())))

    async def _trace(self, request: Request) -> Response:
        return json_response(trace_outline(TRACES[request.path_params["name"]]))

    async def _events(self, request: Request) -> Response:
        return StreamingResponse(self._samples(), media_type="text/event-stream")

    async def _samples(self) -> AsyncIterator[str]:
        while not self._server.should_exit:
            yield f"data: {self._now().model_dump_json()}\n\n"
            await asyncio.sleep(EVERY_S)

    async def _change(self, request: Request) -> Response:
        path, body, player = request.url.path, await request.body(), self._player
        self.asked.append((path, json.loads(body)))
        match path:
            case "/start":
                wanted = parse(StartRequest, body)
                if wanted.trace not in TRACES:
                    raise UnknownTrace("There is no such trace.")
                trace = TRACES[wanted.trace]
                if wanted.delay_ms is not None:
                    trace = trace.with_delay(wanted.delay_ms)
                player.start(trace, loop=wanted.loop)
            case "/stop":
                player.stop()
            case "/pause":
                player.pause()
            case "/resume":
                player.resume()
            case "/seek":
                player.seek(parse(SeekRequest, body).position_ms)
            case "/loop":
                player.set_loop(parse(LoopRequest, body).loop)
            case "/link":
                player.hold(parse(LinkSetting, body))
        return json_response(self._now())

    def _now(self) -> ShaperStatus:
        state = self._player.state
        down, up = (
            DirectionStatus(target_kbps=kbps, delivered_kbps=kbps * 0.8, queue_bytes=9000, queue_ms=12.0, drops=3)
            for kbps in (state.down_kbps, state.up_kbps)
        )
        return self._shaper.status().model_copy(update={"down": down, "up": up})
