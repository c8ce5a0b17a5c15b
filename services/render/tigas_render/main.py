"""Wires the render service together: settings in, servers up, until told to stop."""

from __future__ import annotations

import asyncio
import os
import ssl
import sys
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress

from tigas_common.address import Address, warning_if_open
from tigas_common.errors import StartError, TigasError
from tigas_common.memory import keep_together
from tigas_common.runner import explained, serve_http, until_stopped
from tigas_common.settings import MODELS
from tigas_common.terminal import printable
from tigas_render.app import STATIC, create_app
from tigas_render.cache import kept_key
from tigas_render.certificates import CertificateKeeper
from tigas_render.engine import Engine
from tigas_render.raster.devices import create_rasterizer
from tigas_render.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server
from tigas_render.upstreams import Upstreams

SWITCH_S = 0.0001
"""How often Python's threads take turns, in seconds: at the default, 5 ms, a busy event loop makes each frame late."""


async def serve(settings: RenderSettings) -> None:
    """Run the render service in this process until SIGINT or SIGTERM.

    Raises StartError, also once the device is lost.
    """
    async with AsyncExitStack() as stack:
        service = await stack.enter_async_context(opened(settings, say))
        keeper = await stack.enter_async_context(CertificateKeeper.running(settings))
        keeper.on_renewal(service.show)
        await stack.enter_async_context(service.measured())
        app = await stack.enter_async_context(
            Upstreams.around(create_app(service), settings.upstreams, service.origins)
        )
        if settings.quic:
            with explained(settings.quic, "--quic"):
                server = await stack.enter_async_context(
                    Http3Server(
                        app,
                        host=settings.quic.host,
                        port=settings.quic.port,
                        certificate=keeper.certificate,
                        webtransport={"/render": render_session(service, service.rate)},
                        congestion_control=settings.congestion_control,
                        limits=settings.quic_limits,
                        reset_key=kept_key(settings.cache / "stateless-reset.key"),
                        origins=service.origins,
                        load=service.loop_load,
                    )
                )
            service.quic_port = server.port
            keeper.on_renewal(server.replace_certificate)
        if settings.https:
            tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            keeper.on_renewal(lambda certificate: certificate.load_into(tls))
            with explained(settings.https, "--https"):
                service.https_port = await stack.enter_async_context(
                    serve_http(app, settings.https, settings.http_limits, tls, websockets=True)
                )
        with explained(settings.http, "--http"):
            serving = serve_http(app, settings.http, settings.http_limits, websockets=True)
            port = await stack.enter_async_context(serving)
        say("\n".join(announcement(service, port, (service.device,))))
        await until_stopped_or_lost(until_stopped(), service.engine)


def say(line: str) -> None:
    """Tell the user something."""
    print(line, flush=True)


@asynccontextmanager
async def opened(settings: RenderSettings, say: Callable[[str], None]) -> AsyncIterator[RenderService]:
    """The service without anything that serves it, and the process fit for it. Raises StartError."""
    keep_together()
    _prepare_directory(settings)
    try:
        rasterizer = create_rasterizer(settings.device, settings.cache)
    except ValueError as error:
        raise StartError(str(error)) from None
    say("Preparing the rasteriser (the first start on a machine compiles it, about half a minute) …")
    async with AsyncExitStack() as stack:
        try:
            service = await stack.enter_async_context(RenderService.open(settings, rasterizer))
        except TigasError as error:  # a GPU that is full, or lost
            raise StartError(error.detail) from None
        sys.setswitchinterval(SWITCH_S)
        yield service


async def until_stopped_or_lost(stop: Coroutine[None, None, None], engine: Engine) -> None:
    """Wait for `stop`. Raises StartError if the device is lost first: only a new process can use it."""
    stopped = asyncio.create_task(stop)
    try:
        await asyncio.wait((stopped, engine.device_lost), return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopped.cancel()
    if engine.device_lost.done():
        raise StartError(engine.device_lost.result().detail)


def _prepare_directory(settings: RenderSettings) -> None:
    """Make the models directory if it is the default, or if pages are told to fill it: else its name may be mistyped.

    Where the default cannot be made, the built-in scenes are all there is. Raises StartError.
    """
    scenes = settings.scenes
    if scenes == MODELS or settings.edit_scenes:
        with suppress(OSError):
            scenes.mkdir(exist_ok=True)
        if scenes == MODELS and not scenes.exists():
            return
    if not scenes.is_dir():
        raise StartError(f"The models directory {scenes} does not exist; create it, or choose another with --scenes.")
    if not os.access(scenes, os.R_OK | os.X_OK):
        raise StartError(f"The models directory {scenes} cannot be read; check its permissions.")


def announcement(service: RenderService, http_port: int, devices: Sequence[str]) -> list[str]:
    """What the user is told once the service is served; from now on it knows its own URL, too.

    devices: all that render.
    """
    http = Address(service.settings.http.host, http_port)
    service.url = f"http://{http.reachable_host}:{http.port}"
    lines = []
    scenes = service.registry.infos()
    for scene in scenes:
        if scene.state == "broken":
            lines.append(printable(f"  {scene.id} is left out: {scene.error}"))
    usable = sum(scene.state != "broken" for scene in scenes)
    lines.append(f"{usable} {'scene' if usable == 1 else 'scenes'} ready on {', '.join(devices)}.")
    folder = service.settings.scenes
    if folder.is_dir() and len(scenes) == 1:
        lines.append(f"{folder} has no scenes yet: put a .ply, .sog, .spz or .splat there, or use `tigas scene add`.")
    if not STATIC.is_dir():
        lines.append("Only the API is available, because the page is not built: run `npm ci && npm run build` in web/.")
    if service.https_port:
        lines.append(f"Other devices on the network: https://<this machine's address>:{service.https_port}/")
    if warning := warning_if_open(service.settings.addresses):
        lines.append(warning)
    lines.append(f"Open {service.url}/")
    return lines
