"""Wires the render service together: settings in, servers up, until told to stop."""

from __future__ import annotations

import asyncio
import os
import ssl
import sys
from contextlib import AsyncExitStack
from pathlib import Path

from tigas_common.address import Address, say_if_open
from tigas_common.errors import StartError, TigasError
from tigas_common.memory import keep_together
from tigas_common.runner import explained, serve_http, until_stopped
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

SWITCH_S = 0.0005
"""How often Python's threads take turns, in seconds: at the default, 5 ms, a busy event loop makes each frame late."""


async def serve(settings: RenderSettings) -> None:
    """Run the render service until SIGINT or SIGTERM. Raises StartError, also once the device is lost."""
    keep_together()
    _check_directory(settings.scenes)
    try:
        rasterizer = create_rasterizer(settings.device, settings.cache)
    except ValueError as error:
        raise StartError(str(error)) from None
    print("Preparing the rasteriser (the first start on a machine compiles it, about half a minute) …", flush=True)
    async with AsyncExitStack() as stack:
        try:
            service = await stack.enter_async_context(RenderService.open(settings, rasterizer))
        except TigasError as error:  # a GPU that is full, or lost
            raise StartError(error.detail) from None
        keeper = await stack.enter_async_context(CertificateKeeper.running(settings))
        keeper.on_renewal(service.show)
        await stack.enter_async_context(service.measured())
        app = create_app(service)
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
                    serve_http(app, settings.https, settings.http_limits, tls)
                )
        with explained(settings.http, "--http"):
            port = await stack.enter_async_context(serve_http(app, settings.http, settings.http_limits))
        sys.setswitchinterval(SWITCH_S)
        service.url = f"http://{Address(settings.http.host, port).reachable_host}:{port}"
        _announce(service, Address(settings.http.host, port))
        await _until_stopped(service.engine)


async def _until_stopped(engine: Engine) -> None:
    """Wait for SIGINT or SIGTERM. Raises StartError if the device is lost first: only a new process can use it."""
    stopped = asyncio.create_task(until_stopped())
    try:
        await asyncio.wait((stopped, engine.device_lost), return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopped.cancel()
    if engine.device_lost.done():
        raise StartError(engine.device_lost.result().detail)


def _check_directory(scenes: Path | None) -> None:
    if scenes is None:
        return
    if not scenes.is_dir():
        raise StartError(f"The models directory {scenes} does not exist; create it, or choose another with --scenes.")
    if not os.access(scenes, os.R_OK | os.X_OK):
        raise StartError(f"The models directory {scenes} cannot be read; check its permissions.")


def _announce(service: RenderService, http: Address) -> None:
    scenes = service.registry.infos()
    for scene in scenes:
        if scene.state == "broken":
            print(printable(f"  {scene.id} is left out: {scene.error}"))
    usable = sum(scene.state != "broken" for scene in scenes)
    print(f"{usable} {'scene' if usable == 1 else 'scenes'} ready on {service.device}.")
    if service.settings.scenes is not None and len(scenes) == 1:
        folder = service.settings.scenes
        print(f"{folder} has no scenes yet: put each model in a folder of its own, such as {folder}/garden/garden.ply.")
    if not STATIC.is_dir():
        print("Only the API is available, because the page is not built: run `npm ci && npm run build` in web/.")
    if service.https_port:
        print(f"Other devices on the network: https://<this machine's address>:{service.https_port}/")
    say_if_open(service.settings.addresses)
    print(f"Open http://{http.reachable_host}:{http.port}/", flush=True)
