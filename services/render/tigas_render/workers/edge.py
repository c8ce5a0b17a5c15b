"""An edge, which serves clients with frames and other answers from the engines."""

from __future__ import annotations

import itertools
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from dataclasses import replace

from aioquic.tls import SessionTicket
from starlette.routing import Match
from starlette.types import ASGIApp, Receive, Scope, Send

from tigas_common.origins import OriginCheck, OriginPolicy
from tigas_common.resources import use_one_arena
from tigas_render.admission.load import Load, LoadState
from tigas_render.admission.viewers import ViewerAdmission
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.engines import EnginePool
from tigas_render.server.frame_route import PATH, HttpFrames, frames_app
from tigas_render.server.public_servers import run_public_servers
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.shared_port import Edge, EdgeCounts, PortShare, TicketStore
from tigas_render.uploads.parts_route import PART_ROUTE, uploads_app
from tigas_render.workers.aggregate import EngineAggregator, EngineProxy
from tigas_render.workers.control import (
    Channel,
    EdgeStart,
    Message,
    NewCertificate,
    Ready,
    Start,
    TicketIssued,
    TicketTaken,
    frames_socket,
    http_socket,
)
from tigas_render.workers.process import listen_until_stopped, run_worker

REPORT_TICKS = 10
"""Number of load measurements between two reports to the engines, which are a second apart."""


async def run_edge(channel: Channel, start: Start, messages: AsyncIterator[Message]) -> None:
    """Serve clients until the supervisor stops this process."""
    use_one_arena()
    assert isinstance(start, EdgeStart)
    settings = start.settings
    origins = OriginPolicy.from_addresses(settings.addresses, settings.allow_hosts, settings.allow_origins)
    admission = ViewerAdmission(settings.quic_limits)
    tickets = SharedTickets(channel.send)

    def on_message(message: Message) -> None:
        match message:
            case NewCertificate():
                renew(Certificate.from_pem_with_key(message.pem))
            case TicketIssued() | TicketTaken():
                tickets.on_message(message)
            case _:
                raise AssertionError(f"An edge does not receive {message.kind} messages.")

    async with AsyncExitStack() as stack:
        frames = _connect_engines(start, admission.load)
        await stack.enter_async_context(frames)
        await stack.enter_async_context(admission.monitor(_report_every(REPORT_TICKS, frames)))
        proxies = [EngineProxy(http_socket(start.directory, number), origins) for number in range(len(start.devices))]
        for proxy in proxies:
            stack.push_async_callback(proxy.close)
        frame_app = OriginCheck(frames_app(HttpFrames(frames, admission.http_viewers, admission.rate)), origins)
        rest: ASGIApp = proxies[0]
        if isinstance(frames, EnginePool):
            rest = EngineAggregator(frames, dict(zip(start.devices, proxies, strict=True)), origins)
        renew = await stack.enter_async_context(
            run_public_servers(
                _route_by_path(frame_app, OriginCheck(uploads_app(settings), origins), rest),
                frames,
                admission,
                settings,
                origins,
                certificate=Certificate.from_pem_with_key(start.certificate.pem),
                reset_key=start.reset_key,
                http=_inherited_socket(start.http),
                https=None if start.https is None else _inherited_socket(start.https),
                quic=_port_share(start, tickets) if start.quic else None,
                edges=start.edges,
            )
        )
        channel.send(Ready())
        await listen_until_stopped(messages, on_message)


def _connect_engines(start: EdgeStart, load: Load) -> PipeClient | EnginePool:
    if len(start.devices) == 1:
        return PipeClient(frames_socket(start.directory, 0), start.number, load.record_engine)
    sockets = {device: frames_socket(start.directory, number) for number, device in enumerate(start.devices)}
    return EnginePool(sockets, start.number, load.record_engine, time.monotonic)


def _report_every(ticks: int, engines: PipeClient | EnginePool) -> Callable[[LoadState], None]:
    """Return a callback that reports every `ticks`-th load state to the engines, which publish it."""
    measurements = itertools.count()

    def report(state: LoadState) -> None:
        if next(measurements) % ticks == 0:
            engines.send_stats(state)

    return report


def _route_by_path(frames: ASGIApp, parts: ASGIApp, rest: ASGIApp) -> ASGIApp:
    """Combine applications: frames and parts of uploads are served in this process, everything else by an engine."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        chosen = frames if scope["path"] == PATH else parts if PART_ROUTE.matches(scope)[0] is Match.FULL else rest
        await chosen(scope, receive, send)

    return app


def _port_share(start: EdgeStart, tickets: SharedTickets) -> PortShare:
    edge = Edge(start.number, start.edges)
    sockets = tuple(map(_inherited_socket, start.quic))
    return PortShare(edge, sockets, start.retry_key, tickets, EdgeCounts(start.counts, start.number, start.edges))


def _inherited_socket(fd: int) -> socket.socket:
    return socket.socket(fileno=fd)


class SharedTickets(TicketStore):
    """One edge's copy of the session tickets of all edges, which allows a client to resume its session at any of them.

    Two edges may both take a ticket within a millisecond, which is harmless because early data is idempotent.
    """

    def __init__(self, send: Callable[[TicketIssued | TicketTaken], None]) -> None:
        """send: passes a message to the other edges."""
        super().__init__()
        self._send = send

    def add(self, ticket: SessionTicket) -> None:
        super().add(ticket)
        # aioquic's servers leave the server name empty, since only clients need it
        self._send(TicketIssued(ticket=replace(ticket, server_name=ticket.server_name or "")))

    def pop(self, label: bytes) -> SessionTicket | None:
        ticket = super().pop(label)
        if ticket is not None:
            self._send(TicketTaken(label=label))
        return ticket

    def on_message(self, message: TicketIssued | TicketTaken) -> None:
        """Apply a message from another edge."""
        if isinstance(message, TicketIssued):
            super().add(message.ticket)
        else:
            super().pop(message.label)


if __name__ == "__main__":
    run_worker(run_edge)
