"""A page over HTTPS, as on a phone: every service comes through its own origin."""

from __future__ import annotations

import json
import ssl
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest
from playwright.sync_api import Page, expect

from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.modes import wait_for_stream, with_settings
from tests.web.server import Packager, RenderServer, Store
from tests.web.stage import SCENE

NAME = "My first experiment"
FILE = f"""name = "{NAME}"
scenes = ["pebbles"]
movements = ["stroll"]
networks = ["20mbit,20ms-rtt"]
controllers = [3]
duration_s = 1.5
"""


@pytest.fixture(scope="module")
def secure_url(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page over HTTPS, of a render service with a packager and a store behind it."""
    BUILT_PAGE.require()
    packager = Packager()
    with Store("--results", str(tmp_path_factory.mktemp("results"))) as store:
        known = {"dash": packager.url, "store": store.url}
        behind = {name: f":{urlsplit(url).port}" for name, url in known.items()}
        environment = {"TIGAS_RENDER_SERVICES": json.dumps(behind), "TIGAS_RENDER_UPSTREAMS": json.dumps(known)}
        secure = ("--https", "127.0.0.1:0")
        with RenderServer("--scenes", str(models), *secure, environment=environment) as render:
            packager.render = render.url.rstrip("/")
            with urlopen(f"{render.url}config.json") as answer, packager:
                yield json.load(answer)["https_url"]


def asked(page: Page) -> set[str]:
    """Grows by the origins that the page asks for something."""
    origins: set[str] = set()

    def note(url: str) -> None:
        origins.add("{0.scheme}://{0.netloc}".format(urlsplit(url)))

    page.on("request", lambda request: note(request.url) if request.url.startswith("http") else None)
    page.on("websocket", lambda socket: note(socket.url.replace("ws", "http", 1)))
    return origins


def test_a_page_over_https_plays_dash_and_lists_experiments(secure_url: str, open_page: OpenPage) -> None:
    body = json.dumps({"file": FILE}).encode()
    unchecked = ssl._create_unverified_context()
    with urlopen(f"{secure_url}services/store/experiments", body, context=unchecked) as made:
        assert made.status == 201
        assert made.headers["Location"].startswith("/services/store/experiments/")
    chosen = with_settings(secure_url, mode="dash", reprojection=False, prediction="off")
    page = open_page("#/experiments", url=secure_url, ignore_https_errors=True, **chosen)
    expect(page.get_by_text(NAME)).to_be_visible()
    origins = asked(page)
    with page.expect_websocket() as opened:
        page.goto(f"{secure_url}{SCENE}")
    wait_for_stream(page, at_least=5)
    with opened.value.expect_event("framereceived", lambda text: json.loads(text)["pose"] > 0):
        page.keyboard.press("ArrowRight")
    assert origins == {secure_url.rstrip("/")}
