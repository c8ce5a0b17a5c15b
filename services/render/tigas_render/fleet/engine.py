"""An engine's process: scenes, renderer and HTTP interface, on Unix sockets that only edges reach."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress

from tigas_common.certificate import Certificate
from tigas_common.runner import serve_unix
from tigas_render.app import create_app
from tigas_render.fleet.control import Channel, EngineStart, Message, NewCertificate, Ready, Said, Start
from tigas_render.fleet.places import frames_socket, http_socket
from tigas_render.fleet.process import run, until_told
from tigas_render.main import announcement, opened, until_stopped_or_lost
from tigas_render.pipe.server import PipeServer, serve_edges

CONNECTED_S = 1.0
"""For edges to connect, in seconds: they try ten times as often."""


async def engine(channel: Channel, start: Start, news: AsyncIterator[Message]) -> None:
    """Render until told to stop. Raises StartError, also once the device is lost."""
    assert isinstance(start, EngineStart)
    async with AsyncExitStack() as stack:
        service = await stack.enter_async_context(opened(start.settings, lambda line: channel.send(Said(line=line))))
        service.quic_port, service.https_port = start.quic_port, start.https_port

        def heard(message: Message) -> None:
            assert isinstance(message, NewCertificate)
            service.show(Certificate.with_its_key(message.pem))

        heard(start.certificate)
        await stack.enter_async_context(serve_unix(create_app(service), http_socket(start.directory, start.number)))
        pipes = await stack.enter_async_context(
            serve_edges(
                frames_socket(start.directory, start.number), service, service.engine.state, service.loads.heard_json
            )
        )
        await _connected(pipes, start.edges)
        devices = start.devices if len(start.devices) > 1 else (service.device,)
        channel.send(Ready(lines=tuple(announcement(service, start.http_port, devices))))
        await until_stopped_or_lost(until_told(news, heard), service.engine)


async def _connected(pipes: PipeServer, edges: int) -> None:
    """Wait until edges have found this engine, so that it has its part of the first requests."""
    with suppress(TimeoutError):
        async with asyncio.timeout(CONNECTED_S):
            while len(pipes.edges) < edges:  # noqa: ASYNC110 - for a moment at the start
                await asyncio.sleep(0.01)


if __name__ == "__main__":
    run(engine)
