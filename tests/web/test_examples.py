"""The examples of pages that embed the viewer, with the npm package and from another origin."""

from __future__ import annotations

import io
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Locator, Page, Route, expect

from tests.eventually import wait_until
from tests.prerequisites import NODE_MODULES
from tests.web.bundle import ORIGIN, WEB
from tests.web.conftest import LOOPBACK, OpenPage
from tests.web.server import RenderServer

OpenExample = Callable[[str], Page]
POSITION = "document.querySelector('tigas-viewer').viewer.camera.position"


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built npm package."""
    NODE_MODULES.require()
    folder = tmp_path_factory.mktemp("package")
    subprocess.run(["node", "scripts/build-package.mjs", str(folder)], cwd=WEB, check=True, timeout=120)
    return folder


@pytest.fixture
def open_example(package: Path, open_page: OpenPage, server: RenderServer) -> OpenExample:
    """Opens an example by its name, with the server and the scene under test."""

    def open_(name: str) -> Page:
        def answer(route: Route) -> None:
            path = route.request.url.removeprefix(ORIGIN)
            if path.startswith("dist-package/"):
                route.fulfill(path=package / path.removeprefix("dist-package/"))
            else:
                text = (WEB / path).read_text().replace("http://localhost:8080", server.url)
                route.fulfill(body=text.replace("courtyard", "pebbles"), content_type="text/html")

        page = open_page(url="about:blank", permissions=LOOPBACK)
        page.route(f"{ORIGIN}**", answer)
        page.goto(f"{ORIGIN}examples/{name}.html")
        return page

    return open_


def contrast(view: Locator) -> float:
    """Standard deviation of the picture's brightness, 0 to 128: a picture of a scene has details."""
    with Image.open(io.BytesIO(view.screenshot())) as image:
        return float(np.asarray(image.convert("L"), dtype=np.float64).std())


def shows_frames(viewer: Locator) -> None:
    """Wait for the first frame instead of the poster."""
    expect(viewer.locator(".poster")).to_be_hidden()
    expect(viewer.locator(".message")).to_be_hidden()
    assert contrast(viewer) > 10


def position(page: Page) -> list[float]:
    """Where the first viewer's camera is."""
    found: list[float] = page.evaluate(POSITION)
    return found


def test_one_element(open_example: OpenExample) -> None:
    page = open_example("element")
    viewer = page.locator("tigas-viewer")
    shows_frames(viewer)
    start = position(page)
    page.keyboard.press("w", delay=200)
    assert position(page) == start  # the page has the focus
    viewer.locator(".stage").focus()
    page.keyboard.down("w")
    page.wait_for_function(f"start => String({POSITION}) !== String(start)", arg=start)
    page.keyboard.up("w")
    viewer.get_by_role("button", name="Back to the start").click()
    page.wait_for_function(f"start => String({POSITION}) === String(start)", arg=start)


def test_two_viewers(open_example: OpenExample) -> None:
    page = open_example("two-viewers")
    viewers = page.locator("tigas-viewer")
    for index in range(2):
        shows_frames(viewers.nth(index))
    controllers = page.evaluate("[...document.querySelectorAll('tigas-viewer')].map(e => e.viewer.settings.controller)")
    assert controllers == ["seen", "fixed"]


def test_a_viewer_that_is_controlled_by_code(open_example: OpenExample) -> None:
    page = open_example("by-code")
    expect(page.locator("#state")).to_contain_text("new views per second")
    view = page.locator("#view")
    before = view.screenshot()
    assert contrast(view) > 10
    page.get_by_role("button", name="Fly around").click()
    wait_until(lambda: view.screenshot() != before)
    with page.expect_download() as download:
        page.get_by_role("button", name="Save a picture").click()
    with Image.open(download.value.path()) as picture:
        assert (picture.format, picture.size) == ("PNG", (1280, 720))


def test_an_element_that_is_moved_leaves_no_graphics_context_behind(open_example: OpenExample) -> None:
    page = open_example("element")
    viewer = page.locator("tigas-viewer")
    page.evaluate("""() => {
        const { prototype } = HTMLCanvasElement;
        const { getContext } = prototype;
        window.contexts = new Set();
        prototype.getContext = function (...options) {
            const context = getContext.apply(this, options);
            if (context instanceof WebGL2RenderingContext) contexts.add(context);
            return context;
        };
    }""")
    viewer.evaluate("element => element.setAttribute('mode', 'local')")
    for _ in range(3):
        viewer.evaluate("element => document.body.append(element)")
        shows_frames(viewer)
    assert page.evaluate("contexts.size") >= 3
    viewer.evaluate("element => element.remove()")
    assert page.evaluate("[...contexts].filter((context) => !context.isContextLost()).length") == 0
