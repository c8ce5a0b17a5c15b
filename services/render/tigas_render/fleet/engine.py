"""An engine's process: scenes, renderer and HTTP interface, on Unix sockets that only edges reach."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

from tigas_common.certificate import Certificate
from tigas_common.runner import serve_unix
from tigas_render.app import create_app
from tigas_render.fleet.control import Channel, EngineStart, Message, NewCertificate, Ready, Said, Start
from tigas_render.fleet.places import frames_socket, http_socket
from tigas_render.fleet.process import run, until_told
from tigas_render.main import announcement, opened, until_stopped_or_lost
from tigas_render.pipe.server import serve_edges


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
        await stack.enter_async_context(
            serve_edges(
                frames_socket(start.directory, start.number), service, service.engine.state, service.loads.heard_json
            )
        )
        devices = start.devices if len(start.devices) > 1 else (service.device,)
        channel.send(Ready(lines=tuple(announcement(service, start.http_port, devices))))
        await until_stopped_or_lost(until_told(news, heard), service.engine)


if __name__ == "__main__":
    run(engine)
