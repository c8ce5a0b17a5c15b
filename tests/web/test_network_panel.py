"""The network panel with a fake shaper: display, requests and messages."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.fake_shaper import FakeShaper
from tests.web.server import RenderServer
from tests.web.stage import SCENE, wait_for_frames

WINDOW = {"width": 1000, "height": 900}


@pytest.fixture
def shaper() -> Iterator[FakeShaper]:
    with FakeShaper() as running:
        yield running


@pytest.fixture
def page_url(models: Path, shaper: FakeShaper, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The viewer of a render service that knows the shaper."""
    BUILT_PAGE.require()
    monkeypatch.setenv("TIGAS_RENDER_SERVICES", json.dumps({"shaper": shaper.url}))
    with RenderServer("--scenes", str(models)) as running:
        yield running.url


def test_the_network_panel(shaper: FakeShaper, page_url: str, open_page: OpenPage) -> None:
    page = open_page(SCENE, url=page_url, viewport=WINDOW)
    wait_for_frames(page)

    expect(page.get_by_role("radio", name="stairs")).to_be_checked()
    expect(page.locator(".trace-plot path")).to_have_count(2)
    expect(page.get_by_role("figure", name="Rate to this page").locator("canvas")).to_be_visible()
    expect(page.get_by_role("figure", name="Rate to this page")).to_contain_text("Target 100 Mbit/s")
    expect(page.get_by_role("figure", name="Frames of this page").locator("canvas")).to_be_visible()
    assert inked(page), "the chart is blank"

    page.get_by_role("radio", name="tunnel").check()
    panel = page.locator(".network")
    panel.get_by_label("Loop").uncheck()
    panel.get_by_role("button", name="Play").press("Enter")
    expect(page.locator("[data-network=mode]")).to_contain_text(re.compile(r"Playing tunnel, 0:0\d of 0:08"))
    assert shaper.asked == [("/start", {"trace": "tunnel", "loop": False})]


def inked(page: Page) -> bool:
    """Whether anything is drawn in the first chart."""
    return bool(
        page.locator(".chart canvas").first.evaluate(
            "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some(value => value > 0)"
        )
    )
