"""The viewer in a frame of another site's page, where Chromium's private windows keep storage from it."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import expect

from tests.web.conftest import OpenPage
from tests.web.server import RenderServer
from tests.web.stage import SCENE

SITE = "https://lab.example"
LOOPBACK = ["local-network-access"]
"""Chromium's permission prompt before a public site may show local services."""


def test_a_site_that_is_allowed_shows_the_viewer(models: Path, open_page: OpenPage) -> None:
    with RenderServer("--scenes", str(models), "--allow-origin", SITE) as render:
        page = open_page(expected_errors="Mixed Content", turn=False, permissions=LOOPBACK)
        frame = f'<iframe src="{render.url}{SCENE}" width="1000" height="700"></iframe>'
        page.route(f"{SITE}/", lambda route: route.fulfill(body=frame, content_type="text/html"))
        page.goto(SITE)
        stage = page.frame_locator("iframe").locator(".stage")
        expect(stage).to_have_attribute("data-settled", "true")
        expect(stage).to_have_attribute("data-transport", "webtransport-streams")
        page.goto("about:blank")
