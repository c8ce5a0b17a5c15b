"""Letting a controller choose each frame's profile."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, wait_for_frames, wait_until_settled

LARGE = {"width": 1600, "height": 900}


@pytest.mark.alone  # controllers choose by measured times
def test_a_controller_starts_low_and_climbs_while_the_link_allows(open_page: OpenPage, server: RenderServer) -> None:
    kept = with_settings(server.url, controller="latency-transfer", refine=False)
    page = open_page(SCENE, viewport=LARGE, **kept)
    wait_for_frames(page)
    wait_until_settled(page)
    expect(page.locator("[data-stat=profile]")).to_have_text("Low")
    page.keyboard.down("ArrowRight")
    expect(page.locator("[data-stat=profile]")).to_have_text("High", timeout=60_000)
    page.keyboard.up("ArrowRight")
