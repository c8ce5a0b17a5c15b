"""`POST /render`, which needs nothing but a source of frames, so that every edge process can serve it."""

from __future__ import annotations

import time
from dataclasses import dataclass

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from tigas_common.address import client_network
from tigas_common.errors import InvalidRequest
from tigas_common.proxy import run_until, wait_for_disconnect
from tigas_common.web import ARRIVAL_KEY, EXCEPTION_HANDLERS, NO_STORE, PICTURES, described, read_message
from tigas_common.wire.render import RenderRequest
from tigas_render.admission.viewers import HttpViewers, RequestRate
from tigas_render.frame import Client, Frame, FrameSource, Transport

PATH = "/render"
VIEWER_HEADER, MAX_NAME_LENGTH = "Tigas-Viewer", 64
"""The header by which a viewer identifies itself, and its maximum length in characters."""
CLIENT_GONE = 499
"""The status for a client that disconnected before its answer, and so never reads it."""


@dataclass(frozen=True, slots=True)
class HttpFrames:
    """A source of frames, and the admission of its clients."""

    source: FrameSource
    viewers: HttpViewers
    rate: RequestRate


def frames_app(frames: HttpFrames) -> Starlette:
    app = Starlette(routes=[FRAME_ROUTE], exception_handlers=EXCEPTION_HANDLERS)
    app.state.frames = frames
    return app


@described(takes=RenderRequest, gives=PICTURES)
async def render(request: Request) -> Response:
    """One frame."""
    began = time.monotonic()
    frames: HttpFrames = request.app.state.frames
    client = _client(request, frames.viewers)
    frames.rate.check(client)
    render_request = await read_message(request, RenderRequest)
    if render_request.video is not None:
        raise InvalidRequest("format: h264 needs a WebTransport session, as a video's frames refer to each other.")
    arrived = getattr(request.state, ARRIVAL_KEY, began)
    answer = frames.source.submit(client, render_request, arrived)
    frame = await run_until(wait_for_disconnect(request.receive), answer)
    if frame is None:
        return Response(status_code=CLIENT_GONE)
    timing = frame.timing
    headers = {
        "Server-Timing": f"queue;dur={timing.queue}, render;dur={timing.render}, encode;dur={timing.encode}",
        "Tigas-Frame": _frame_header(frame, frames.rate.announced_rate),
        **NO_STORE,
        "Timing-Allow-Origin": "*",
    }
    body = bytes(frame.body)  # a slow reader must not hold a buffer that other frames need
    frame.release()
    return Response(body, headers=headers, media_type=frame.content_type)


def _frame_header(frame: Frame, requests_per_s: float | None) -> str:
    """The frame's `Tigas-Frame` header."""
    numbers = {
        "seq": frame.seq,
        "width": frame.width,
        "height": frame.height,
        "margin_x": frame.margin_x or None,
        "margin_y": frame.margin_y or None,
        "profile": frame.profile,
        "coarse": 1 if frame.coarse else None,
        "requests_per_s": requests_per_s,
    }
    return ", ".join(f"{name}={number}" for name, number in numbers.items() if number is not None)


def _viewer_name(request: Request) -> str:
    """The viewer's identifier, which distinguishes it from others behind the same gateway."""
    name = request.headers.get(VIEWER_HEADER, "")
    if len(name) > MAX_NAME_LENGTH:
        raise InvalidRequest(f"{VIEWER_HEADER}: a name has at most {MAX_NAME_LENGTH} characters.")
    return name


def _client(request: Request, viewers: HttpViewers) -> Client:
    """Admit the viewer. Each of its connections has its own queue. Raises ServerFull."""
    peer = request.client
    transport: Transport = "http3" if request.scope["http_version"] == "3" else "http1"
    address, connection = (client_network(peer.host), f"{peer.host}:{peer.port}") if peer else ("unknown", "unknown")
    name = viewers.admit(address, _viewer_name(request))
    return Client(address, f"{name}/{connection}" if name else connection, transport)


FRAME_ROUTE = Route(PATH, render, methods=["POST"])
"""The route, for an application with HttpFrames as `state.frames`."""
