"""The viewer in a frame of another site's page, where Chromium's private windows keep storage from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import LOOPBACK, OpenPage
from tests.web.server import RenderServer
from tests.web.stage import SCENE

SITE = "https://lab.example"


@pytest.fixture(scope="module")
def url(models: Path) -> Iterator[str]:
    """A server that allows the site."""
    with RenderServer("--scenes", str(models), "--allow-origin", SITE) as render:
        yield render.url


@pytest.fixture
def embedded(url: str, open_page: OpenPage) -> Iterator[Callable[[str], Page]]:
    """Opens the site's page."""
    page = open_page(expected_errors="Mixed Content", permissions=LOOPBACK)

    def open_(body: str) -> Page:
        page.route(f"{SITE}/", lambda route: route.fulfill(body=body, content_type="text/html"))
        page.goto(SITE)
        return page

    yield open_
    page.goto("about:blank")


def test_a_site_that_is_allowed_shows_the_viewer(url: str, embedded: Callable[[str], Page]) -> None:
    page = embedded(f'<iframe src="{url}{SCENE}" width="1000" height="700"></iframe>')
    stage = page.frame_locator("iframe").locator(".stage")
    expect(stage).to_have_attribute("data-settled", "true")
    expect(stage).to_have_attribute("data-transport", "webtransport-streams")


def test_the_page_around_the_frame_controls_the_view(url: str, embedded: Callable[[str], Page]) -> None:
    page = embedded(f"""<iframe src="{url}{SCENE}?noui" width="1000" height="700"></iframe><script>
        const answers = new Map();
        const answer = (id) => new Promise((resolve) => answers.set(id, resolve));
        addEventListener("message", ({{ data }}) => answers.get(data.id ?? data.tigas)?.(data));
        const loaded = answer("loaded");
        const ask = (message) => {{
            document.querySelector("iframe").contentWindow.postMessage(message, "{url}");
            return answer(message.id);
        }};
    </script>""")
    assert page.evaluate("loaded") == {"tigas": "loaded", "scene": "pebbles"}
    frame = page.frame_locator("iframe")
    expect(frame.locator(".stage")).to_have_attribute("data-settled", "true")
    expect(frame.get_by_role("button")).to_have_count(0)
    camera = {"position": [1, -2, 3], "quaternion": [0, 0, 0, 1]}
    asked = {"tigas": "camera", "id": 1, "camera": camera, "duration": 100}
    assert page.evaluate("message => ask(message)", asked) == {"tigas": "camera", "id": 1, "camera": camera}
    taken = "ask({tigas: 'screenshot', id: 2, width: 80}).then(({screenshot: {type, size}}) => [type, size > 500])"
    assert page.evaluate(taken) == ["image/png", True]
