"""DASH over HTTP/3 with and without trust in the server; the experiments' browser has it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest
from playwright.sync_api import Browser, expect

from tests.web.conftest import CHROMIUM, CHROMIUM_ARGS, OpenPage, streaming
from tests.web.modes import wait_for_stream, with_settings
from tests.web.server import Packager
from tests.web.stage import SCENE
from tests.web.test_motion_to_photon import turning
from tigas_common.wire.render import ServerConfig
from tigas_experiments.run.browser import http3_arguments

PLAIN = {"mode": "dash", "reprojection": False, "prediction": "off", "sidebar": False}


@pytest.fixture(scope="module")
def url(models: Path) -> Iterator[str]:
    """The page of a render service that also proxies a packager."""
    with streaming(models, Packager(), proxied=True) as url:
        yield url


@pytest.fixture(scope="module")
def trusting(browser: Browser, url: str) -> Iterator[Browser]:
    with urlopen(f"{url}config.json") as answer:
        config = ServerConfig.model_validate_json(answer.read())
    launched = browser.browser_type.launch(executable_path=CHROMIUM, args=[*CHROMIUM_ARGS, *http3_arguments(config)])
    yield launched
    launched.close()


@pytest.mark.parametrize(("transport", "protocol"), [("h3", "h3"), ("tcp", "http/1.1")])
@pytest.mark.parametrize("preset", ["tuned", "edge"])
def test_segments_come_over_the_chosen_transport(
    trusting: Browser, url: str, preset: str, transport: str, protocol: str
) -> None:
    chosen = with_settings(url, **PLAIN, dashPreset=preset, dashTransport=transport)
    with trusting.new_context(viewport={"width": 480, "height": 270}, **chosen) as context:
        page = context.new_page()
        page.goto(url + SCENE)
        wait_for_stream(page, at_least=5)
        plan = {"points": turning(), "duration_ms": 1500, "capture_every_ms": 0}
        run = page.evaluate("plan => tigas.run(plan)", plan)
    assert run["dash"]["protocols"] == [protocol]
    assert len({frame["pose"] for frame in run["frames"]}) > 1


def test_a_browser_that_does_not_trust_the_server_says_so(open_page: OpenPage, url: str) -> None:
    chosen = with_settings(url, **PLAIN, dashTransport="h3")
    page = open_page(SCENE, url=url, expected_errors="net::ERR_", **chosen)
    expect(page.locator(".stage-message")).to_contain_text("does not trust the server’s certificate")
