"""Letting a controller choose each frame's profile, or choosing it oneself."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, wait_for_frames, wait_until_settled

LARGE, SMALL = {"width": 1600, "height": 900}, {"width": 480, "height": 420}


@pytest.mark.alone  # controllers choose by measured times
def test_a_controller_starts_low_and_climbs_while_the_link_allows(open_page: OpenPage, server: RenderServer) -> None:
    kept = with_settings(server.url, controller="latency-transfer", refine=False)
    page = open_page(SCENE, viewport=LARGE, **kept)
    wait_for_frames(page)
    wait_until_settled(page)
    expect(page.locator("[data-stat=profile]")).to_have_text("Low")
    page.keyboard.down("ArrowRight")
    expect(page.locator("[data-stat=profile]")).to_have_text("High", timeout=20_000)
    page.keyboard.up("ArrowRight")


@pytest.mark.alone  # controllers choose by measured times
def test_profiles_larger_than_the_picture_are_for_a_person_to_choose(open_page: OpenPage, server: RenderServer) -> None:
    kept = with_settings(server.url, controller="latency-transfer", refine=False, hudDetails=True)
    page = open_page(SCENE, viewport=SMALL, **kept)
    wait_for_frames(page)
    page.keyboard.down("ArrowRight")
    expect(page.locator("[data-stat=profile]")).to_have_text("Medium-Low", timeout=20_000)
    wait_for_frames(page, 60)
    expect(page.locator("[data-stat=profile]")).to_have_text("Medium-Low")
    page.keyboard.up("ArrowRight")
    page.evaluate("() => window.tigas.settings({controller: 'fixed', profile: 0})")
    expect(page.locator("[data-stat=profile]")).to_have_text("High")


def test_profiles_can_be_chosen_only_while_no_controller_chooses(open_page: OpenPage) -> None:
    page = open_page(SCENE)
    wait_for_frames(page)
    low = page.get_by_role("radio", name="Low").last
    expect(page.get_by_label("Adaptation")).to_have_value("seen")
    expect(low).to_be_disabled()
    page.get_by_label("Adaptation").select_option("fixed")
    low.check()
    page.get_by_label("Sharpen when you stop").uncheck()
    expect(page.locator("[data-stat=profile]")).to_have_text("Low")
    page.get_by_label("Adaptation").select_option("l2a")
    expect(low).to_be_disabled()
