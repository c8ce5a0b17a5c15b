"""A resting view gets the screen's own pixels, and a moving one its rung again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, wait_for_frames, wait_until_settled

pytestmark = pytest.mark.alone  # a server that is slow at the moment refuses such large frames

STAGE = (700, 400)
SHARP = f"{2 * STAGE[0]} × {2 * STAGE[1]}"
LOWEST = {"controller": "fixed", "profile": 3, "hudDetails": True, "sidebar": False, "transport": "fetch"}


@pytest.fixture(scope="module")
def server(models: Path) -> Iterator[RenderServer]:
    """One without other viewers: while any is active, it refuses pictures above its best rung."""
    BUILT_PAGE.require()
    with RenderServer("--scenes", str(models)) as running:
        yield running


def test_at_rest_the_picture_has_the_screens_own_pixels(open_page: OpenPage, server: RenderServer) -> None:
    page = open_page(SCENE, device_scale_factor=2, **with_settings(server.url, **LOWEST))
    wait_for_frames(page)
    box = page.locator(".stage").bounding_box()
    size = page.viewport_size
    assert box is not None
    assert size is not None
    beside, above = size["width"] - round(box["width"]), size["height"] - round(box["height"])
    page.set_viewport_size({"width": STAGE[0] + beside, "height": STAGE[1] + above})
    expect(page.locator("[data-stat=resolution]")).to_have_text(SHARP)
    wait_until_settled(page)
    assert page.locator(".stage canvas").first.evaluate("canvas => [canvas.width, canvas.height]") == [1400, 800]
    page.keyboard.down("ArrowRight")
    expect(page.locator("[data-stat=profile]")).to_have_text("Low")
    page.keyboard.up("ArrowRight")
    expect(page.locator("[data-stat=resolution]")).to_have_text(SHARP)
