"""An engine, with scenes, renderer and HTTP interface, on Unix sockets that only edges can reach."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress

from tigas_common.loop_share import LoopShare
from tigas_common.runner import serve_unix
from tigas_render.pipe.server import PipeServer, serve_edges
from tigas_render.server.app import create_app
from tigas_render.server.main import announce, open_service, wait_until_stopped_or_lost
from tigas_render.transport.certificate import Certificate
from tigas_render.workers.control import (
    Channel,
    EngineStart,
    Message,
    NewCertificate,
    PrintLine,
    Ready,
    Start,
    frames_socket,
    http_socket,
)
from tigas_render.workers.process import listen_until_stopped, run_worker

CONNECT_TIMEOUT_S = 1.0
"""Seconds to wait for edges to connect, which they try ten times per second."""


async def run_engine(channel: Channel, start: Start, messages: AsyncIterator[Message]) -> None:
    """Render until the supervisor stops this process. Raises StartError, also if the device is lost."""
    assert isinstance(start, EngineStart)
    async with AsyncExitStack() as stack:
        service = await stack.enter_async_context(
            open_service(start.settings, lambda line: channel.send(PrintLine(line=line)))
        )
        service.quic_port, service.https_port = start.quic_port, start.https_port

        def on_message(message: Message) -> None:
            assert isinstance(message, NewCertificate)
            service.set_certificate(Certificate.from_pem_with_key(message.pem))

        on_message(start.certificate)
        share = start.settings.http_limits.loop_share_per_address
        app = LoopShare(create_app(service), share, service.origins)
        await stack.enter_async_context(serve_unix(app, http_socket(start.directory, start.number)))
        pipes = await stack.enter_async_context(
            serve_edges(
                frames_socket(start.directory, start.number), service, service.engine.state, service.loads.update
            )
        )
        await _wait_for_edges(pipes, start.edges)
        devices = start.devices if len(start.devices) > 1 else (service.device,)
        channel.send(Ready(lines=tuple(announce(service, start.http_port, devices))))
        await wait_until_stopped_or_lost(listen_until_stopped(messages, on_message), service)


async def _wait_for_edges(pipes: PipeServer, edges: int) -> None:
    """Wait until the edges have connected, so that this engine gets its share of the first requests."""
    with suppress(TimeoutError):
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            while len(pipes.edges) < edges:  # noqa: ASYNC110 - only briefly at the start
                await asyncio.sleep(0.01)


if __name__ == "__main__":
    run_worker(run_engine)
