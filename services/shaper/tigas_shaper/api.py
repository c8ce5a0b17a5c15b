"""The shaper's HTTP interface: Starlette routes, and the metrics of the link.

Requests that change something need an `Origin` allowed by the policy. Browsers send it automatically, so that no other
page can change the link; command-line tools must add it (`curl -H 'Origin: http://localhost:8080' …`).
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from typing import get_args

from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.errors import Overloaded
from tigas_common.metrics import RequestMetrics, labelled_counter, labelled_gauge, metrics_route, new_registry
from tigas_common.openapi import index, openapi
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.web import (
    BYTES,
    EXCEPTION_HANDLERS,
    JSON,
    NO_STORE,
    ModelResponse,
    described,
    healthy,
    json_response,
    read_body,
    read_message,
)
from tigas_common.wire.shaper import (
    MAX_UPLOAD_BYTES,
    DirectionStatus,
    LinkSetting,
    LoopRequest,
    PlaybackMode,
    SeekRequest,
    ShaperStatus,
    StartRequest,
    TraceList,
    TracePoints,
    TraceSummary,
)
from tigas_shaper.link.link import LinkClosed
from tigas_shaper.service import Shaper
from tigas_shaper.traces.library import summarise, trace_outline

BYTES_PER_KBIT = 125
MAX_WATCHERS = 64
MAX_UPLOADING = 4
"""Maximum number of concurrent uploads: each may take a few hundred megabytes until it is parsed."""


def create_app(shaper: Shaper, policy: OriginPolicy) -> ASGIApp:
    """The application for a running shaper, which the caller opens and closes."""
    registry = new_registry("shaper", ShaperMetrics(shaper))
    app = Starlette(
        routes=[
            index("Network shaper"),
            openapi("Network shaper"),
            Route("/traces", traces),
            Route("/traces", upload, methods=["POST"]),
            Route("/traces/{name}", trace),
            Route("/start", start, methods=["POST"]),
            Route("/stop", stop, methods=["POST"]),
            Route("/pause", pause, methods=["POST"]),
            Route("/resume", resume, methods=["POST"]),
            Route("/seek", seek, methods=["POST"]),
            Route("/loop", loop, methods=["POST"]),
            Route("/link", link, methods=["POST"]),
            Route("/status", status),
            Route("/events", events),
            Route("/healthz", healthz),
            metrics_route(registry),
        ],
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.shaper = shaper
    app.state.watchers = 0
    app.state.uploading = 0
    app.state.reading = asyncio.Lock()
    return RequestMetrics(OriginCheck(app, policy), app.routes, registry)


async def traces(request: Request) -> ModelResponse[TraceList]:
    """All traces, with summaries."""
    return json_response(TraceList(traces=tuple(await asyncio.to_thread(_shaper(request).library.summaries))))


@described(query={"name": "The file's name."}, takes=(BYTES,))
async def upload(request: Request) -> ModelResponse[TraceSummary]:
    """Store a trace in any supported format."""
    state = request.app.state
    if state.uploading >= MAX_UPLOADING:
        raise Overloaded(f"{MAX_UPLOADING} traces are already being uploaded; try again later.")
    state.uploading += 1
    try:
        data = await read_body(request, MAX_UPLOAD_BYTES)
        name = request.query_params.get("name", "uploaded")[:255]
        async with state.reading:  # each takes a processor for a second
            added = await asyncio.to_thread(_shaper(request).library.add, name, data)
            answer = await asyncio.to_thread(summarise, added, uploaded=True)
    finally:
        state.uploading -= 1
    return json_response(answer)


async def trace(request: Request) -> ModelResponse[TracePoints]:
    """A trace's outline, for drawing."""
    found = await asyncio.to_thread(_shaper(request).library.get, request.path_params["name"])
    return json_response(await asyncio.to_thread(trace_outline, found))


@described(takes=StartRequest)
async def start(request: Request) -> ModelResponse[ShaperStatus]:
    """Play a trace."""
    wanted = await read_message(request, StartRequest)
    found = await asyncio.to_thread(_shaper(request).library.get, wanted.trace)
    if wanted.delay_ms is not None:
        found = await asyncio.to_thread(found.with_delay, wanted.delay_ms)
    _shaper(request).player.start(found, loop=wanted.loop)
    return _status(request)


async def stop(request: Request) -> ModelResponse[ShaperStatus]:
    """Return to the constant rate of the settings."""
    _shaper(request).player.stop()
    return _status(request)


async def pause(request: Request) -> ModelResponse[ShaperStatus]:
    """Hold the current state."""
    _shaper(request).player.pause()
    return _status(request)


async def resume(request: Request) -> ModelResponse[ShaperStatus]:
    """Continue playing."""
    _shaper(request).player.resume()
    return _status(request)


@described(takes=SeekRequest)
async def seek(request: Request) -> ModelResponse[ShaperStatus]:
    """Go to a position in the trace."""
    _shaper(request).player.seek((await read_message(request, SeekRequest)).position_ms)
    return _status(request)


@described(takes=LoopRequest)
async def loop(request: Request) -> ModelResponse[ShaperStatus]:
    """Set whether to start over at the end."""
    _shaper(request).player.set_loop((await read_message(request, LoopRequest)).loop)
    return _status(request)


@described(takes=LinkSetting)
async def link(request: Request) -> ModelResponse[ShaperStatus]:
    """Hold one constant state."""
    _shaper(request).player.hold(await read_message(request, LinkSetting))
    return _status(request)


async def status(request: Request) -> ModelResponse[ShaperStatus]:
    """The link's current status."""
    return _status(request)


@described(gives=("text/event-stream",))
async def events(request: Request) -> Response:
    """The link's status about five times per second, as server-sent events with a ShaperStatus each."""
    return _Events(_event_stream(request), media_type="text/event-stream", headers=NO_STORE)


class _Events(StreamingResponse):
    """Counts a response until its end, starting before its first byte, which a client may delay."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        state = scope["app"].state
        if state.watchers >= MAX_WATCHERS:
            raise Overloaded(f"{MAX_WATCHERS} pages are already watching the link.")
        state.watchers += 1
        try:
            await super().__call__(scope, receive, send)
        finally:
            state.watchers -= 1


async def _event_stream(request: Request) -> AsyncIterator[str]:
    async for seen in _shaper(request).watch():
        yield f"data: {seen.model_dump_json()}\n\n"


@described(gives=(JSON,))
async def healthz(request: Request) -> Response:
    """Whether the link works."""
    closed = _shaper(request).closed_reason
    if closed is not None:
        raise LinkClosed(closed)
    return healthy()


def _shaper(request: Request) -> Shaper:
    shaper: Shaper = request.app.state.shaper
    return shaper


def _status(request: Request) -> ModelResponse[ShaperStatus]:
    return json_response(_shaper(request).status())


class ShaperMetrics(Collector):
    """Metrics of one link. Trace names are not labels, as anybody may upload some."""

    def __init__(self, shaper: Shaper) -> None:
        self._shaper = shaper

    def collect(self) -> Iterator[Metric]:
        status, sent = self._shaper.status(), self._shaper.sent_bytes
        link, directions = status.link, {"down": status.down, "up": status.up}

        def per_direction(value: Callable[[DirectionStatus], float]) -> dict[str, float]:
            return {name: value(direction) for name, direction in directions.items()}

        drops, rates = per_direction(lambda one: one.drops), per_direction(lambda one: one.target_kbps * BYTES_PER_KBIT)
        waiting, ages = per_direction(lambda one: one.queue_bytes), per_direction(lambda one: one.queue_ms / 1000)
        modes = {mode: mode == status.mode for mode in get_args(PlaybackMode)}
        yield labelled_counter("tigas_shaper_sent_bytes", "Delivered bytes", "direction", sent)
        yield labelled_counter("tigas_shaper_dropped_packets", "Packets dropped by a full queue", "direction", drops)
        yield labelled_gauge("tigas_shaper_rate_bytes_per_second", "Current rate of the link", "direction", rates)
        yield labelled_gauge("tigas_shaper_queue_bytes", "Waiting bytes", "direction", waiting)
        yield labelled_gauge(
            "tigas_shaper_queue_age_seconds", "Queueing delay of a packet arriving now", "direction", ages
        )
        yield labelled_gauge("tigas_shaper_playback", "Playback state: 1 for the current one", "mode", modes)
        yield GaugeMetricFamily("tigas_shaper_delay_seconds", "Added one-way delay", link.delay_ms / 1000)
        yield GaugeMetricFamily("tigas_shaper_loss_ratio", "Share of packets lost at random", link.loss_pct / 100)
        yield GaugeMetricFamily("tigas_shaper_link_up", "Whether the link is open", status.closed is None)
