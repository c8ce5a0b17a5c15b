"""The services under test: a lab on this machine, started for the runs, or running services at a URL."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from urllib.parse import urlsplit

import httpx
import psutil

from tigas_common.errors import StartError, TigasError
from tigas_common.processes import end_with_parent, terminate, tigas_command
from tigas_common.render_requests import RenderClient
from tigas_common.topology import PAGE_ORIGINS
from tigas_common.wire.render import LadderName, SceneInfo, ServerConfig

LAB_URL = PAGE_ORIGINS[0]
START_S = 120
"""Long, as the first start on a machine compiles the rasteriser."""
STOP_S = 15
ANSWER_S = 10
"""Long, for busy machines."""
VARYING_FIELDS = {"retry_after_s", "max_upload_bytes"}
"""Fields of the configuration that depend on the load and on free disk space."""


@dataclass(frozen=True, slots=True)
class Target:
    """URLs and processes of the services under test."""

    url: str
    """Without a trailing slash; also the page's origin."""
    config: ServerConfig
    lab: psutil.Process | None = None
    """The lab's process, if this command started it."""
    processes: frozenset[psutil.Process] = frozenset()
    """The lab's services."""

    @property
    def shaper(self) -> str | None:
        return self.config.services.get("shaper")

    @property
    def dash(self) -> str | None:
        return self.config.services.get("dash")


@asynccontextmanager
async def lab_target(ladder: LadderName) -> AsyncIterator[Target]:
    """Run the namespace lab, as a context manager. Raises StartError."""
    await asyncio.to_thread(check_lab)
    if await _is_serving(LAB_URL):
        raise StartError(f"Something is already serving {LAB_URL}; stop it, or measure it with --url {LAB_URL}.")
    # In a separate session, so that Ctrl+C only reaches this process and runs end before their services. The lab ends
    # if this process dies.
    process = subprocess.Popen(  # noqa: ASYNC220 - returns immediately
        end_with_parent(tigas_command("lab", "up")),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1", "TIGAS_RENDER_LADDER": ladder},
    )
    log = asyncio.create_task(asyncio.to_thread(_read_last_line, process))
    try:
        target = await _wait_until_ready(process, log)
        lab = psutil.Process(process.pid)
        yield replace(target, lab=lab, processes=frozenset(lab.children()))
    finally:
        await asyncio.shield(asyncio.to_thread(_stop_lab, process))


@asynccontextmanager
async def url_target(url: str) -> AsyncIterator[Target]:
    """Connect to running services. Raises StartError."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise StartError(f"{url!r} is not the URL of a viewer, such as {LAB_URL}.")
    base = f"{parts.scheme}://{parts.netloc}"
    yield Target(base, await read_config(base))


async def read_config(url: str) -> ServerConfig:
    """Read the configuration of the services at a URL. Raises StartError."""
    async with httpx.AsyncClient(base_url=url, trust_env=False, verify=False) as http:
        try:
            return await RenderClient(http).config(ANSWER_S)
        except TigasError:
            raise StartError(f"No TIGAS render service answers at {url}.") from None


async def find_fault(target: Target) -> str | None:
    """One sentence if a service does not answer or was restarted, or the link is closed; otherwise None.

    A restarted render service has another certificate in its configuration, a restarted lab service another process.
    """
    try:
        config = await read_config(target.url)
    except StartError as error:
        return str(error)
    fixed = ServerConfig.model_fields.keys() - VARYING_FIELDS
    if changed := sorted(name for name in fixed if getattr(config, name) != getattr(target.config, name)):
        return f"The render service was restarted or changed: {', '.join(changed)}."
    if target.lab is not None:
        try:
            ended = target.processes.difference(target.lab.children())
        except psutil.Error:
            return "The lab has ended."
        if ended:
            return f"A service of the lab has ended: process {', '.join(str(one.pid) for one in ended)}."
    services = [url for url in (target.url, target.shaper, target.dash) if url is not None]
    answers = [await _is_serving(url, ANSWER_S) for url in services]
    silent = [url for url, answer in zip(services, answers, strict=True) if not answer]
    return f"{' and '.join(silent)} did not answer, or does not work." if silent else None


async def load_scene(url: str, scene: str, *, download: bool = False) -> SceneInfo:
    """Load a scene, prepare its download if requested, and return its description. Raises StartError."""
    try:
        async with RenderClient.connect(url) as service:
            info = await service.load(scene)
            if download and info.downloads:
                await service.prepare_download(info.id)
            return info
    except TigasError as error:
        raise StartError(f"The scene {scene!r} cannot be loaded from {url}: {error}") from None


def check_lab() -> None:
    """Raise StartError with one sentence if the lab cannot run on this machine."""
    advice = "give running services with --url instead"
    run = subprocess.run(tigas_command("lab", "check"), capture_output=True, text=True)
    if run.returncode:
        reason = run.stderr.strip().splitlines()
        raise StartError(f"{reason[-1] if reason else 'The lab cannot be started.'} Or {advice}.")
    if shutil.which("setpriv") is None:
        raise StartError(f"The lab needs setpriv: sudo apt-get install util-linux, or {advice}.")


async def _wait_until_ready(process: subprocess.Popen[bytes], log: asyncio.Task[str]) -> Target:
    latest = time.monotonic() + START_S
    while time.monotonic() < latest:
        if process.poll() is not None:
            raise StartError(f"The lab did not start: {await log or 'it gave no reason'}")
        if await _is_serving(LAB_URL):
            target = Target(LAB_URL, await read_config(LAB_URL))
            if await find_fault(target) is None:
                return target
        await asyncio.sleep(0.3)
    raise StartError(f"The lab's services did not answer within {START_S} s.")


async def _is_serving(url: str, patience_s: float = 2) -> bool:
    async with httpx.AsyncClient(timeout=patience_s, trust_env=False, verify=False) as http:
        with contextlib.suppress(httpx.HTTPError):
            return (await http.get(f"{url.rstrip('/')}/healthz")).is_success
    return False


def _read_last_line(process: subprocess.Popen[bytes]) -> str:
    """The last line of the process's error output, once it has ended."""
    assert process.stderr is not None
    last = ""
    with process.stderr as stream:
        for line in stream:
            last = line.decode(errors="replace").strip() or last
    return last


def _stop_lab(process: subprocess.Popen[bytes]) -> None:
    terminate(process, STOP_S)
    if process.returncode < 0:  # killed, so that it has not cleaned up
        subprocess.run(tigas_command("lab", "down"), capture_output=True)
