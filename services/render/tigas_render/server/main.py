"""The render service in a single process, and the start and stop code that it shares with an engine process."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress

from tigas_common.address import Address, open_warning
from tigas_common.errors import StartError, TigasError
from tigas_common.resources import use_one_arena
from tigas_common.runner import wait_for_stop
from tigas_common.settings import MODELS
from tigas_common.terminal import printable
from tigas_render.local_files import load_or_create_key
from tigas_render.raster.devices import create_rasterizer
from tigas_render.server.app import STATIC, create_app
from tigas_render.server.certificates import CertificateRenewer
from tigas_render.server.public_servers import run_public_servers
from tigas_render.server.public_sockets import PublicSockets
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_render.transport.shared_port import PortShare

logger = logging.getLogger(__name__)

LOST_GRACE_S = 5.0
"""Seconds in which a process must exit after its device is lost."""
MAX_LISTED_BROKEN = 20
"""Maximum number of broken scenes that the start message lists."""
THREAD_SWITCH_S = 0.0001
"""Python's thread switch interval in seconds: with the default, 5 ms, a busy event loop delays every frame."""


async def serve(settings: RenderSettings) -> None:
    """Run the render service in this process until SIGINT or SIGTERM. Raises StartError, also if the device is lost."""
    async with AsyncExitStack() as stack:
        sockets = stack.enter_context(PublicSockets.open(settings, 1))
        service = await stack.enter_async_context(open_service(settings, print_line))
        service.quic_port, service.https_port = sockets.quic_port, sockets.https_port
        renewer = await stack.enter_async_context(CertificateRenewer.run(settings))
        renewer.add_listener(service.set_certificate)
        await stack.enter_async_context(service.monitor_load())
        renew = await stack.enter_async_context(
            run_public_servers(
                create_app(service),
                service,
                service.admission,
                settings,
                service.origins,
                certificate=renewer.certificate,
                reset_key=load_or_create_key(settings.cache / "stateless-reset.key"),
                http=sockets.http,
                https=sockets.https,
                quic=PortShare(sockets=sockets.quic[0]) if sockets.quic else None,
            )
        )
        renewer.add_listener(renew)
        print_line("\n".join(announce(service, sockets.http_port, (service.device,))))
        await wait_until_stopped_or_lost(wait_for_stop(), service)


def print_line(line: str) -> None:
    print(line, flush=True)


@asynccontextmanager
async def open_service(settings: RenderSettings, print_line: Callable[[str], None]) -> AsyncIterator[RenderService]:
    """Prepare the process and open the service, without any servers, as a context manager. Raises StartError."""
    use_one_arena()
    _prepare_directory(settings)
    try:
        rasterizer = create_rasterizer(settings.device, settings.cache)
    except ValueError as error:
        raise StartError(str(error)) from None
    print_line("Preparing the rasteriser (the first start on a machine compiles it, about half a minute) …")
    async with AsyncExitStack() as stack:
        try:
            service = await stack.enter_async_context(RenderService.open(settings, rasterizer))
        except TigasError as error:  # a GPU out of memory, or lost
            raise StartError(error.detail) from None
        sys.setswitchinterval(THREAD_SWITCH_S)
        yield service


async def wait_until_stopped_or_lost(stop: Coroutine[None, None, None], service: RenderService) -> None:
    """Wait for `stop`, then end long-running work. Raises StartError if the device is lost first, since only a new
    process can use it. The process then exits within `LOST_GRACE_S`, even if threads are stuck in calls to the device.
    """
    engine = service.engine
    stopped = asyncio.create_task(stop)
    try:
        await asyncio.wait((stopped, engine.device_lost), return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopped.cancel()
        service.abort_work()
    if engine.device_lost.done():
        reason = engine.device_lost.result().detail
        logger.error("%s", reason)  # the process may be killed before it reports the StartError
        end = threading.Timer(LOST_GRACE_S, os._exit, (1,))
        end.daemon = True
        end.start()
        raise StartError(reason)


def _prepare_directory(settings: RenderSettings) -> None:
    """Create the models directory if it is the default or if pages may add scenes; any other path may be a typo.

    If the default cannot be created, only the built-in scenes are available. Raises StartError.
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


def announce(service: RenderService, http_port: int, devices: Sequence[str]) -> list[str]:
    """Set the service's URL, and return the lines of the start message. devices: the rendering devices' names."""
    http = Address(service.settings.http.host, http_port)
    service.url = f"http://{http.reachable_host}:{http.port}"
    lines = []
    scenes = service.registry.scene_infos()
    broken = [scene for scene in scenes if scene.state == "broken"]
    lines += [printable(f"  {scene.id} is left out: {scene.error}") for scene in broken[:MAX_LISTED_BROKEN]]
    if len(broken) > MAX_LISTED_BROKEN:
        lines.append(f"  {len(broken) - MAX_LISTED_BROKEN} more are left out.")
    usable = sum(scene.state != "broken" for scene in scenes)
    lines.append(f"{usable} {'scene' if usable == 1 else 'scenes'} ready on {', '.join(devices)}.")
    folder = service.settings.scenes
    if folder.is_dir() and all(scene.builtin for scene in scenes):
        lines.append(f"{folder} has no scenes yet: put a .ply, .sog, .spz or .splat there, or use `tigas scene add`.")
    if not STATIC.is_dir():
        lines.append("Only the API is available, because the page is not built: run `npm ci && npm run build` in web/.")
    if service.https_port:
        lines.append(f"Other devices on the network: https://<this machine's address>:{service.https_port}/")
    if warning := open_warning(service.settings.addresses):
        lines.append(warning)
    lines.append(f"Open {service.url}/")
    return lines
