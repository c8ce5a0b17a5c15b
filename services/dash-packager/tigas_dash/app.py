"""The packager's HTTP interface: only Starlette routes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from tigas_common.address import parse_host
from tigas_common.errors import TigasError, problem
from tigas_common.metrics import RequestMetrics, metrics_route, new_registry
from tigas_common.openapi import index, openapi
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.parsing import parse
from tigas_common.web import (
    EXCEPTION_HANDLERS,
    NO_STORE,
    TEXT,
    ModelResponse,
    created_response,
    described,
    healthz,
    json_response,
    list_response,
    read_message,
)
from tigas_common.wire.dash import (
    MAX_SDP,
    FrameShown,
    PoseUpdate,
    SessionInfo,
    SessionRequest,
    SessionStatus,
    WebRtcRequest,
    WebRtcSession,
)
from tigas_dash.clock import xs_datetime
from tigas_dash.errors import UnknownSegment, UnknownSession
from tigas_dash.session import DashStream
from tigas_dash.sessions import Sessions
from tigas_dash.stream import Stream
from tigas_dash.webrtc.stream import WebRtcServer

MAX_OFFER = 2 * MAX_SDP
"""Maximum size of a body with an offer, in bytes: JSON escapes line ends."""
TIME_FROM_MANIFEST = "../../time"
"""Path of `time` relative to a manifest, which works for any origin and path."""
STREAM_ENDED = 4001
"""Close code of the pose socket if the stream has ended."""
UNKNOWN_SESSION = 4004
"""Close code of the pose socket if there is no such session."""
POSE_PAUSE_S = 0.001
"""Pause after each pose that gives other tasks a turn, as no viewer needs a thousand per second."""


def create_app(sessions: Sessions, policy: OriginPolicy, webrtc: WebRtcServer) -> ASGIApp:
    """The application for running sessions, which the caller opens and closes."""
    registry = new_registry("dash", sessions.metrics)
    app = Starlette(
        routes=[
            index("DASH packager"),
            openapi("DASH packager"),
            Route("/sessions", open_session, methods=["POST"]),
            Route("/sessions", list_sessions),
            Route("/webrtc", open_webrtc, methods=["POST"]),
            Route("/sessions/{session}", end_session, methods=["DELETE"]),
            Route("/sessions/{session}", session_status),
            WebSocketRoute("/sessions/{session}/poses", poses),
            Route("/sessions/{session}/manifest.mpd", manifest),
            Route("/sessions/{session}/{representation}/init.mp4", init_segment),
            Route("/sessions/{session}/{representation}/{segment:str}.m4s", media_segment),
            Route("/time", time),
            Route("/healthz", healthz),
            metrics_route(registry),
        ],
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.sessions = sessions
    app.state.webrtc = webrtc
    return RequestMetrics(OriginCheck(app, policy), app.routes, registry)


@described(takes=SessionRequest)
async def open_session(request: Request) -> ModelResponse[SessionInfo]:
    """Open a stream."""
    sessions = _sessions(request)
    session = await sessions.open(await read_message(request, SessionRequest))
    await _end_if_disconnected(request, session)
    return created_response(session.info, f"/sessions/{session.name}")


async def _end_if_disconnected(request: Request, session: Stream) -> None:
    if await request.is_disconnected():  # the client would never learn the session's name
        await _sessions(request).end(session.name)


@described(takes=WebRtcRequest)
async def open_webrtc(request: Request) -> ModelResponse[WebRtcSession]:
    """Answer an offer to stream over WebRTC."""
    webrtc: WebRtcServer = request.app.state.webrtc
    wanted = await read_message(request, WebRtcRequest, MAX_OFFER)
    host = parse_host(request.headers["host"]) or ""
    session = await _sessions(request).start(lambda: webrtc.create_stream(wanted, host))
    await _end_if_disconnected(request, session)
    return created_response(session.info, f"/sessions/{session.name}")


async def list_sessions(request: Request) -> ModelResponse[list[SessionStatus]]:
    """Status of all streams."""
    return list_response(session.status for session in _sessions(request).all())


async def session_status(request: Request) -> ModelResponse[SessionStatus]:
    """Status of a stream."""
    return json_response(_sessions(request).get(request.path_params["session"]).status)


async def end_session(request: Request) -> Response:
    """End a stream."""
    await _sessions(request).end(request.path_params["session"])
    return Response(status_code=204)


@described(gives=("application/dash+xml",))
async def manifest(request: Request) -> Response:
    """The stream's MPD."""
    published = _sessions(request).clock.wall_now()
    body = _session(request).media.manifest(TIME_FROM_MANIFEST, published)
    return Response(body, media_type="application/dash+xml", headers=NO_STORE)


@described(gives=("video/mp4",))
async def init_segment(request: Request) -> Response:
    """The CMAF header of a representation."""
    track = _session(request).media.track(request.path_params["representation"])
    return Response(track.header, media_type="video/mp4", headers=NO_STORE)


@described(gives=("video/iso.segment",))
async def media_segment(request: Request) -> Response:
    """A segment, sent while it grows. If it is about to begin, the response waits."""
    session = _session(request)
    track, number = session.media.track(request.path_params["representation"]), request.path_params["segment"]
    if not (number.isascii() and number.isdecimal() and len(number) <= 12):
        raise UnknownSegment("Segments are numbered from 1.")
    chunks = track.segments.read(int(number))

    async def count_sent() -> AsyncIterator[bytes]:
        async with asyncio.timeout(session.media.readable_s):  # does not keep segments in memory for a stalled reader
            async for chunk in chunks:
                session.count_sent(track.representation.rung, len(chunk))
                yield chunk

    headers = {**NO_STORE, "Timing-Allow-Origin": "*"}  # shows the protocol to pages on another port
    return StreamingResponse(count_sent(), media_type="video/iso.segment", headers=headers)


@described(gives=(TEXT,))
async def time(request: Request) -> Response:
    """The stream's wall-clock time, as xs:dateTime."""
    return PlainTextResponse(xs_datetime(_sessions(request).clock.wall_now()), headers=NO_STORE)


async def poses(socket: WebSocket) -> None:
    """Receive the viewer's poses and report the pose of each frame. Invalid messages are answered with an error."""
    await socket.accept()
    sessions: Sessions = socket.app.state.sessions
    try:
        session = _require_dash(sessions.get(socket.path_params["session"]))
    except TigasError as error:
        await socket.close(UNKNOWN_SESSION, error.detail)
        return
    async with session.subscribe() as frames:
        announcing = asyncio.create_task(_send_frames(socket, frames))
        listening = asyncio.create_task(_receive_poses(socket, session))
        await asyncio.wait((announcing, listening), return_when=asyncio.FIRST_COMPLETED)
        for task in (announcing, listening):
            task.cancel()
        await asyncio.gather(announcing, listening, return_exceptions=True)


async def _send_frames(socket: WebSocket, frames: asyncio.Queue[FrameShown | None]) -> None:
    while (shown := await frames.get()) is not None:
        await socket.send_text(shown.model_dump_json())
    await socket.close(STREAM_ENDED, "The stream has ended.")


async def _receive_poses(socket: WebSocket, session: DashStream) -> None:
    with suppress(WebSocketDisconnect):
        while (message := await socket.receive())["type"] != "websocket.disconnect":
            try:
                session.set_pose(parse(PoseUpdate, message.get("bytes") or (message.get("text") or "").encode()))
            except TigasError as error:
                await socket.send_text(problem(error).model_dump_json())
            await asyncio.sleep(POSE_PAUSE_S)


def _sessions(request: Request) -> Sessions:
    sessions: Sessions = request.app.state.sessions
    return sessions


def _session(request: Request) -> DashStream:
    return _require_dash(_sessions(request).get(request.path_params["session"]))


def _require_dash(stream: Stream) -> DashStream:
    if not isinstance(stream, DashStream):
        raise UnknownSession("The session is not a DASH stream.")
    return stream
