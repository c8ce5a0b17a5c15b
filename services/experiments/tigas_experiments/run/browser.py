"""Headless Chromium with the viewer in it, and the viewer's bridge for scripts (`window.tigas`, web/README.md)."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote, urlsplit

from playwright.async_api import Browser, BrowserContext, Error, Page, async_playwright
from pydantic import Field, ValidationError

from tigas_common.errors import StartError
from tigas_common.parsing import describe_error
from tigas_common.wire.model import Entries, WireModel
from tigas_common.wire.render import ServerConfig
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.files import parse_recording
from tigas_experiments.wire.recording import Recording, Sample
from tigas_experiments.wire.run import RunPlan

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = (
    "--headless=new",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--no-first-run",
    "--mute-audio",
    "--autoplay-policy=no-user-gesture-required",
    "--disable-renderer-backgrounding",
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
)
HARDWARE_ARGUMENTS = ("--use-angle=vulkan", "--enable-features=Vulkan", "--ignore-gpu-blocklist")
"""Required for hardware WebGL in headless Chromium."""
WEBGPU_ARGUMENT = "--enable-unsafe-webgpu"
"""Required for WebGPU in headless Chromium."""
HARDWARE_WEBGPU_ARGUMENTS = (WEBGPU_ARGUMENT, "--disable-vulkan-surface")
"""Headless Chromium has no Vulkan surface; as long as it looks for one, WebGPU falls back to software."""
SOFTWARE_WEBGPU_ARGUMENTS = ("--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader")
"""Where there is no graphics processor: correct, and slow."""
GRAPHICS_DEVICES = ("nvidia0", "dri/renderD*")
"""Device files in /dev; a display controller alone (`dri/card0`) cannot render."""
READY_MS = 60_000
"""How long the viewer may take from being opened to its first frame."""
ANSWER_S = 60
"""Timeout for a page's answer, in case its processes hang."""
CLOSE_S = 10


def find_chromium() -> str:
    """The browser's path. Raises StartError."""
    for name in NAMES:
        if path := shutil.which(name):
            return path
    raise StartError("No Chromium or Chrome is installed: sudo apt-get install chromium")


@asynccontextmanager
async def launch_chromium(config: ServerConfig | None = None, *, webgpu: bool = False) -> AsyncIterator[Browser]:
    """A headless browser during the context, optionally with WebGPU. Raises StartError.

    It uses the graphics processor if one is available with a Vulkan driver, and HTTP/3 of a server.
    """
    path = find_chromium()
    # As root it has no sandbox to go into.
    arguments = [*ARGUMENTS, *(["--no-sandbox"] if os.geteuid() == 0 else []), *graphics_arguments(webgpu=webgpu)]
    arguments += http3_arguments(config)
    async with async_playwright() as playwright:
        try:
            browser = await playwright.chromium.launch(
                executable_path=path, args=arguments, handle_sigint=False, handle_sigterm=False
            )
        except Error as error:
            raise StartError(f"{path} did not start: {_first_line(error)}") from None
        try:
            yield browser
        finally:
            await _close(browser)


def graphics_arguments(*, webgpu: bool, devices: Path = Path("/dev")) -> tuple[str, ...]:
    """Chromium's arguments for this machine's graphics; `devices` is the kernel's device directory."""
    hardware = any(True for pattern in GRAPHICS_DEVICES for _ in devices.glob(pattern))
    if hardware:
        return (*HARDWARE_ARGUMENTS, *HARDWARE_WEBGPU_ARGUMENTS) if webgpu else HARDWARE_ARGUMENTS
    return (WEBGPU_ARGUMENT, *SOFTWARE_WEBGPU_ARGUMENTS) if webgpu else ()


def http3_arguments(config: ServerConfig | None) -> tuple[str, ...]:
    """Chromium's arguments to fetch DASH over HTTP/3 from a server with its own certificate."""
    if config is None or config.dash_h3_url is None:
        return ()
    return (
        f"--origin-to-force-quic-on={urlsplit(config.dash_h3_url).netloc}",
        f"--ignore-certificate-errors-spki-list={config.public_key_sha256}",
    )


async def is_responsive(browser: Browser) -> bool:
    """Whether the browser and its connection are alive; Playwright does not notice the death of its own process."""
    try:
        async with asyncio.timeout(CLOSE_S):
            session = await browser.new_browser_cdp_session()
            await session.send("Browser.getVersion")
            await session.detach()
    except (Error, TimeoutError):
        return False
    return True


class SampleList(WireModel):
    """The samples of a run that the page has."""

    samples: Entries[Sample]
    pictures: Entries[Annotated[str, Field(pattern=r"^[0-9]{6,10}\.(jpg|enhanced\.webp|enhanced\.png)$")]]
    """Files that belong to them, by name."""
    problem: str | None
    """Why there are no more."""


class Viewer:
    """A viewer's page. Every failure is a RunFailed with one sentence."""

    def __init__(self, page: Page) -> None:
        self._page = page

    async def prepare(self, settings: dict[str, Any], pose: object) -> None:
        """Change settings, connect again, stand at a pose, and wait until a frame of it is on the screen and models are
        loaded.

        What the connection learned of the network while the page was loaded would influence the run otherwise.
        """
        await self._call("settings", settings)
        await self._call("reconnect", None)
        await self._call("stand", pose)
        try:
            await self._page.wait_for_function("() => window.tigas?.state().ready === true", timeout=READY_MS)
        except Error:
            said = await self._state()
            raise RunFailed(f"The viewer showed no frame within {READY_MS // 1000} s: {said}") from None
        await self.check()

    async def check(self) -> None:
        """Raise RunFailed unless the page enhances, reprojects or draws frames as configured."""
        state = await self._call("state", None)
        if isinstance(state, dict) and state.get("problem"):
            raise RunFailed(f"Frames are not shown as they should be: {state['problem']}")

    async def record(self, plan: RunPlan, patience_s: float) -> Recording:
        """Play a movement and record it. Also raises BrokenRecording."""
        recorded = await self._call("run", plan.model_dump(), patience_s)
        return parse_recording(recorded)

    async def capture(self, index: int) -> bytes:
        """One kept picture, as PNG; it is given up by the page then."""
        picture = await self._call("capture", index)
        if not isinstance(picture, str):
            raise RunFailed(f"The viewer sent no image {index}.")
        return base64.b64decode(picture)

    async def samples(self) -> SampleList:
        told = await self._call("samples", None)
        try:
            return SampleList.model_validate_json(json.dumps(told))
        except ValidationError as error:
            raise RunFailed(f"The viewer's samples cannot be used: {describe_error(error)}") from None

    async def sample_picture(self, name: str) -> bytes:
        picture = await self._call("samplePicture", name)
        if not isinstance(picture, str):
            raise RunFailed(f"The viewer sent no image {name}.")
        return base64.b64decode(picture)

    async def _call(self, name: str, argument: object, patience_s: float = ANSWER_S) -> Any:
        # As text, both ways: a structured clone of thousands of small objects takes seconds.
        script = "async ([name, argument]) => JSON.stringify((await window.tigas[name](JSON.parse(argument))) ?? null)"
        try:
            async with asyncio.timeout(patience_s):
                answer = await self._page.evaluate(script, [name, json.dumps(argument)])
        except TimeoutError:
            raise RunFailed(f"The viewer did not answer within {patience_s:g} s ({name}).") from None
        except Error as error:
            raise RunFailed(f"The viewer failed: {_first_line(error)}") from None
        return answer if name == "run" else json.loads(answer)

    async def _state(self) -> str:
        try:
            return json.dumps(await self._call("state", None))
        except RunFailed as error:
            return str(error)


@asynccontextmanager
async def open_viewer(browser: Browser, url: str, scene: str, width: int, height: int) -> AsyncIterator[Viewer]:
    """The viewer of a scene in a fresh context: no settings, cache or storage of earlier runs. Raises RunFailed."""
    try:
        context = await browser.new_context(viewport={"width": width, "height": height}, ignore_https_errors=True)
    except Error as error:
        raise RunFailed(f"The browser could not open a page: {_first_line(error)}") from None
    try:
        try:
            page = await context.new_page()
            await page.goto(f"{url}/#/scene/{quote(scene, safe='')}", timeout=READY_MS)
            await page.wait_for_function("() => window.tigas !== undefined", timeout=READY_MS)
        except Error as error:
            raise RunFailed(f"The viewer at {url} could not be opened: {_first_line(error)}") from None
        yield Viewer(page)
    finally:
        await _close(context)


async def _close(what: Browser | BrowserContext) -> None:
    """It is, or it is so dead that it does not answer."""
    with contextlib.suppress(Error, TimeoutError):
        async with asyncio.timeout(CLOSE_S):
            await what.close()


def _first_line(error: Error) -> str:
    return error.message.strip().splitlines()[0] if error.message.strip() else "no reason given"
