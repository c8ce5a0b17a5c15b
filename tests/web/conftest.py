"""A real server, a real browser, and pages that fail their test when they complain on the console."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Page,
    ViewportSize,
    expect,
    sync_playwright,
)

from tests.web.scenes import write_scenes
from tests.web.server import Packager, RenderServer

STATIC = Path(__file__).parents[2] / "services/render/tigas_render/static/index.html"
CHROMIUM = shutil.which("chromium")
CHROMIUM_ARGS = ["--headless=new", "--no-sandbox", "--disable-background-networking", "--disable-component-update"]
PATIENCE = 30_000
"""Milliseconds: how long a test waits for what must come, on a machine that may be busy."""
DESKTOP: ViewportSize = {"width": 1000, "height": 640}
SLOW_READ = "GPU stall due to ReadPixels"
"""What Chromium says of itself where no graphics processor composes the page: it reads what WebGL drew."""
NO_ADAPTER = "No available adapters"
"""And where WebGPU was asked for and finds none."""

OpenPage = Callable[..., Page]


@pytest.fixture(scope="session")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A models directory with a small scene and a broken one."""
    directory = tmp_path_factory.mktemp("models")
    write_scenes(directory)
    return directory


@pytest.fixture(scope="session")
def server(models: Path) -> Iterator[RenderServer]:
    """The render service as a user starts it, on free ports."""
    if not STATIC.exists():
        pytest.skip("the web client is not built: cd web && npm ci && npm run build")
    with RenderServer("--scenes", str(models)) as running:
        yield running


@pytest.fixture(scope="module")
def packager() -> Packager:
    """Not started yet. Streams end only when they are told to: nobody waits for them to become idle."""
    return Packager("--idle-s", "600")


@pytest.fixture(scope="module")
def viewer_url(models: Path, packager: Packager) -> Iterator[str]:
    """The viewer of a render service that knows the packager; both run."""
    if not STATIC.exists():
        pytest.skip("the web client is not built: cd web && npm ci && npm run build")
    services = {"TIGAS_RENDER_SERVICES": json.dumps({"dash": packager.url})}
    with RenderServer("--scenes", str(models), environment=services) as render:
        packager.render = render.url.rstrip("/")
        with packager:
            yield render.url


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium: the one that Playwright would download is not needed."""
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: sudo apt-get install chromium")
    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser, server: RenderServer) -> Iterator[OpenPage]:
    """Opens pages; the test fails if one of them logs an error, unless it is told which ones to expect.

    A test that has a service of its own takes it before this: fixtures end in the opposite order, and a page whose
    service has gone complains.
    """
    contexts: list[BrowserContext] = []
    complaints: list[str] = []

    def open_(path: str = "", *, url: str = server.url, expected_errors: str | None = None, **options: Any) -> Page:
        context = browser.new_context(**{"viewport": DESKTOP, **options})
        context.set_default_timeout(PATIENCE)
        contexts.append(context)
        page = context.new_page()

        def on_console(message: ConsoleMessage) -> None:
            said = message.text
            harmless = SLOW_READ in said or NO_ADAPTER in said or (expected_errors and expected_errors in said)
            if message.type in ("error", "warning") and not harmless:
                complaints.append(f"{message.type}: {said}")

        page.on("console", on_console)
        page.on("pageerror", lambda error: complaints.append(f"uncaught: {error}"))
        page.goto(url + path)
        return page

    yield open_
    for context in contexts:
        context.close()
    assert not complaints
