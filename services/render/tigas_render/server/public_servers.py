"""The public servers of one process: HTTP, HTTPS, and HTTP/3 with WebTransport, over a source of frames."""

from __future__ import annotations

import socket
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

from starlette.types import ASGIApp

from tigas_common.limits import HttpLimits
from tigas_common.loop_share import LoopShare
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_listener
from tigas_render.admission.limits import Limits
from tigas_render.admission.viewers import ViewerAdmission
from tigas_render.frame import FrameSource
from tigas_render.server.frame_route import PATH
from tigas_render.server.upstreams import UpstreamProxy
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server
from tigas_render.transport.shared_port import PortShare


@asynccontextmanager
async def run_public_servers(
    app: ASGIApp,
    frames: FrameSource,
    admission: ViewerAdmission,
    settings: RenderSettings,
    origins: OriginPolicy,
    *,
    certificate: Certificate,
    reset_key: bytes,
    http: socket.socket,
    https: socket.socket | None,
    quic: PortShare | None,
    edges: int = 1,
) -> AsyncIterator[Callable[[Certificate], None]]:
    """Serve, as a context manager that yields a function to replace the certificate for new connections.

    app: the HTTP interface without the proxied services. frames: the source for WebTransport sessions, in this process
    or behind a pipe. http, https: listening sockets. edges: the number of processes that share the limits.
    """
    limits = HttpLimits.from_settings(settings.http_limits).per_process(edges)
    listeners: list[Callable[[Certificate], None]] = []
    async with AsyncExitStack() as stack:
        app = await stack.enter_async_context(UpstreamProxy.open(app, settings.upstreams, origins, edges))
        app = LoopShare(app, limits.loop_share_per_address, origins)
        if https is not None:
            tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            certificate.load_into(tls)
            listeners.append(lambda renewed: renewed.load_into(tls))
            await stack.enter_async_context(serve_listener(app, https, limits, tls, websockets=True))
        await stack.enter_async_context(serve_listener(app, http, limits, websockets=True))
        if quic is not None:  # closed first, to notify viewers at once: HTTP/1.1 may wait for long answers
            server = Http3Server(
                app,
                certificate=certificate,
                webtransport={PATH: render_session(frames, admission.rate)},
                limits=Limits.of(settings.quic_limits).of_each(edges),
                congestion_control=settings.congestion_control,
                reset_key=reset_key,
                origins=origins,
                share=quic,
                load=admission.load,
            )
            await stack.enter_async_context(server)
            listeners.append(server.replace_certificate)

        def renew(renewed: Certificate) -> None:
            for listener in listeners:
                listener(renewed)

        yield renew
