"""A real server, a real browser, and pages that fail their test when they complain on the console."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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

from tests import prerequisites
from tests.prerequisites import BUILT_PAGE
from tests.web.experiments import PageLab, page_lab
from tests.web.scenes import write_scenes
from tests.web.server import TIGAS, Packager, RenderServer

CHROMIUM = shutil.which("chromium")
CHROMIUM_ARGS = ["--headless=new", "--no-sandbox", "--disable-background-networking", "--disable-component-update"]
PATIENCE = 30_000
"""Milliseconds to wait for an expected event, on a possibly busy machine."""
DESKTOP: ViewportSize = {"width": 1000, "height": 640}
SLOW_READ = "GPU stall due to ReadPixels"
"""Chromium's own message without a GPU compositor: it reads back WebGL's drawing."""
NO_ADAPTER = "No available adapters"
"""And where WebGPU was asked for and finds none."""

TURN = "try { sessionStorage.setItem('tigas.turning', 'forced') } catch {}"
"""Browsers under test draw in software, where the page warps pictures only on demand: it takes half a processor."""

FAMILIAR = """(([open]) => {
  try {
    const chosen = JSON.parse(localStorage.getItem('tigas.settings') ?? '{}');
    localStorage.setItem('tigas.settings', JSON.stringify({ hint: false, sidebar: open, ...chosen }));
  } catch {}
})([%s])"""
"""A visitor who has moved before, and has the lab open or not. Settings that are stored stay."""

LOOPBACK = ["local-network-access"]
"""Chromium's permission prompt before a public site, or a page that the test answers itself, may use local services."""

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
    BUILT_PAGE.require()
    with RenderServer("--scenes", str(models)) as running:
        yield running


@pytest.fixture(scope="session")
def packager() -> Packager:
    """The packager that `viewer_url` starts."""
    return Packager()


@pytest.fixture(scope="session")
def viewer_url(models: Path, packager: Packager) -> Iterator[str]:
    """The viewer of a render service that knows the packager; both run."""
    with streaming(models, packager) as url:
        yield url


@pytest.fixture(scope="module")
def lab(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageLab]:
    """A viewer with a store and a shaper."""
    with page_lab(models, tmp_path_factory.mktemp("lab")) as running:
        yield running


@contextmanager
def streaming(
    models: Path, packager: Packager, program: Sequence[str] = TIGAS, *, proxied: bool = False
) -> Iterator[str]:
    """A render service that knows the packager, and may be its proxy, and the packager; the URL of the viewer."""
    BUILT_PAGE.require()
    known = json.dumps({"dash": packager.url})
    environment = {"TIGAS_RENDER_SERVICES": known} | ({"TIGAS_RENDER_UPSTREAMS": known} if proxied else {})
    with RenderServer("--scenes", str(models), environment=environment, program=program) as render:
        packager.render = render.url.rstrip("/")
        with packager:
            yield render.url


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium, instead of a download by Playwright."""
    prerequisites.CHROMIUM.require()
    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser, server: RenderServer) -> Iterator[OpenPage]:
    """Opens pages; the test fails if one of them logs an error that does not match `expected_errors`, an expression.

    A test with a private service requests it before this: fixtures end in reverse order, and a page whose service has
    ended logs errors. On screens with room for it, the lab is open, unless the page is for a newcomer. Pictures are
    warped with `turn` only.
    """
    contexts: list[BrowserContext] = []
    complaints: list[str] = []

    def open_(
        path: str = "",
        *,
        url: str = server.url,
        expected_errors: str | None = None,
        turn: bool = False,
        newcomer: bool = False,
        **options: Any,
    ) -> Page:
        options = {"viewport": DESKTOP, **options}
        context = browser.new_context(**options)
        if not newcomer:
            roomy = options["viewport"]["width"] >= 800 and options["viewport"]["height"] >= 500
            context.add_init_script(FAMILIAR % json.dumps(roomy))
        if turn:
            context.add_init_script(TURN)
        context.set_default_timeout(PATIENCE)
        contexts.append(context)
        page = context.new_page()

        def on_console(message: ConsoleMessage) -> None:
            said = message.text
            expected = expected_errors is not None and re.search(expected_errors, said)
            harmless = SLOW_READ in said or NO_ADAPTER in said or expected
            if message.type in ("error", "warning") and not harmless:
                complaints.append(f"{message.type}: {said}")

        page.on("console", on_console)
        page.on("pageerror", lambda error: complaints.append(f"uncaught: {error}"))
        page.goto(url + path)
        return page

    yield open_
    for context in contexts:
        for page in context.pages:
            page.unroute_all(behavior="ignoreErrors")  # a request under way would fail in the next test
        context.close()
    assert not complaints
