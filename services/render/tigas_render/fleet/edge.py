"""An edge's process: it speaks with clients, and has from the engines whatever it answers."""

from __future__ import annotations

import asyncio
import itertools
import os
import socket
import ssl
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

from pydantic import TypeAdapter
from starlette.routing import Match
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.certificate import Certificate
from tigas_common.memory import keep_together
from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.runner import serve_listener
from tigas_render.fleet.control import (
    Channel,
    EdgeStart,
    Message,
    NewCertificate,
    Ready,
    Start,
    TicketIssued,
    TicketTaken,
)
from tigas_render.fleet.places import frames_socket, http_socket
from tigas_render.fleet.process import run, until_told
from tigas_render.fleet.proxy import EngineProxy
from tigas_render.fleet.tickets import SharedTickets
from tigas_render.fleet.united import United
from tigas_render.frame_route import PATH, HttpFrames, frames_app
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.engines import Engines
from tigas_render.transport.cids import Edge
from tigas_render.transport.frames import render_session
from tigas_render.transport.http_viewers import HttpViewers
from tigas_render.transport.load import TICK_S, Load, LoadState
from tigas_render.transport.relay import Relay
from tigas_render.transport.request_rate import RequestRate
from tigas_render.transport.server import Http3Server
from tigas_render.transport.share import Share
from tigas_render.uploads.parts_route import PART, uploads_app
from tigas_render.upstreams import Upstreams

TELL_TICKS = 10
"""How often engines hear of this edge's load: a second."""
_STATE = TypeAdapter(LoadState)


async def edge(channel: Channel, start: Start, news: AsyncIterator[Message]) -> None:
    """Serve clients until told to stop."""
    keep_together()
    assert isinstance(start, EdgeStart)
    for fd in start.others:
        os.close(fd)
    settings = start.settings
    limits = settings.quic_limits.of_each(start.edges)
    http_limits = settings.http_limits.of_each(start.edges)
    origins = OriginPolicy.of(settings.addresses, settings.allow_hosts, settings.allow_origins)
    tickets = SharedTickets(channel.send)
    certificate = Certificate.with_its_key(start.certificate.pem)
    load = Load()
    rate = RequestRate(load, limits.requests_per_s, time.monotonic)
    server: Http3Server | None = None
    tls: ssl.SSLContext | None = None

    def heard(message: Message) -> None:
        match message:
            case NewCertificate():
                renewed = Certificate.with_its_key(message.pem)
                if server is not None:
                    server.replace_certificate(renewed)
                if tls is not None:
                    renewed.load_into(tls)
            case TicketIssued() | TicketTaken():
                tickets.heard(message)
            case _:
                raise AssertionError(f"An edge does not hear {message.kind}.")

    async with AsyncExitStack() as stack:
        frames = _frames(start, load)
        await stack.enter_async_context(frames)
        stack.callback(asyncio.create_task(_measure(load, frames)).cancel)
        proxies = [EngineProxy(http_socket(start.directory, number), origins) for number in range(len(start.devices))]
        for proxy in proxies:
            stack.push_async_callback(proxy.close)
        posted = OriginCheck(frames_app(HttpFrames(frames, HttpViewers(load, time.monotonic), rate)), origins)
        rest: ASGIApp = proxies[0]
        if isinstance(frames, Engines):
            rest = United(frames, dict(zip(start.devices, proxies, strict=True)), origins)
        parts = OriginCheck(uploads_app(settings), origins)
        app = await stack.enter_async_context(
            Upstreams.around(_by_path(posted, parts, rest), settings.upstreams, origins, start.edges)
        )
        if start.quic:
            server = Http3Server(
                app,
                certificate=certificate,
                webtransport={PATH: render_session(frames, rate)},
                congestion_control=settings.congestion_control,
                limits=limits,
                reset_key=start.reset_key,
                origins=origins,
                share=_share(start, tickets),
                load=load,
            )
            await stack.enter_async_context(server)
        if start.https is not None:
            tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            certificate.load_into(tls)
            await stack.enter_async_context(
                serve_listener(app, _inherited(start.https), http_limits, tls, websockets=True)
            )
        await stack.enter_async_context(serve_listener(app, _inherited(start.http), http_limits, websockets=True))
        channel.send(Ready())
        await until_told(news, heard)


def _frames(start: EdgeStart, load: Load) -> PipeClient | Engines:
    if len(start.devices) == 1:
        return PipeClient(frames_socket(start.directory, 0), start.number, load.engine)
    sockets = {device: frames_socket(start.directory, number) for number, device in enumerate(start.devices)}
    return Engines(sockets, start.number, load.engine, time.monotonic)


async def _measure(load: Load, engines: PipeClient | Engines) -> None:
    """Measure how busy this process is, and let the engines know, which show it."""
    for tick in itertools.count():
        await asyncio.sleep(TICK_S)
        load.tick()
        if tick % TELL_TICKS == 0:
            engines.tell(_STATE.dump_json(load.state))


def _by_path(frames: ASGIApp, parts: ASGIApp, rest: ASGIApp) -> ASGIApp:
    """Frames, and what uploads consist of, are this process's own business; everything else is the engine's."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        chosen = frames if scope["path"] == PATH else parts if PART.matches(scope)[0] is Match.FULL else rest
        await chosen(scope, receive, send)

    return app


def _share(start: EdgeStart, tickets: SharedTickets) -> Share:
    of = Edge(start.number, start.edges)
    sockets = tuple(map(_inherited, start.quic))
    relay = None
    if start.relay is not None:
        relay = Relay(of, _inherited(start.relay), [_inherited(fd) for fd in start.relays])
    return Share(of, sockets, start.retry_key, tickets, relay)


def _inherited(fd: int) -> socket.socket:
    return socket.socket(fileno=fd)


if __name__ == "__main__":
    run(edge)
