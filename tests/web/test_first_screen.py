"""What a newcomer sees and downloads, and what stays behind the lab."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.web.conftest import OpenPage
from tests.web.stage import SCENE, changes, expect_apart, hold, resize, wait_for_frames, wait_until_settled

HINT = "Drag to look · WASD or wheel to move · double-click to go there"
CHUNKS = "() => performance.getEntriesByType('resource').map(({ name }) => name.split('/').at(-1))"


def test_a_newcomer_sees_the_scene_one_line_and_how_to_move(open_page: OpenPage) -> None:
    page = open_page(SCENE, newcomer=True)
    wait_for_frames(page)
    wait_until_settled(page)
    expect(page.get_by_text(HINT)).to_be_visible()
    expect(page.get_by_role("region", name="Status")).to_contain_text("Live")
    expect(page.get_by_role("complementary")).to_have_count(0)
    assert changes(page, lambda: hold(page, "ArrowRight")) > 1
    expect(page.get_by_text(HINT)).to_have_count(0)
    expect(page.locator(".status-line [data-stat=motion-to-photon]")).to_be_visible()
    page.reload()
    wait_for_frames(page)
    expect(page.get_by_text(HINT)).to_have_count(0)


def test_a_notice_and_how_to_move_do_not_overlap(open_page: OpenPage) -> None:
    page = open_page(f"{SCENE}?mode=film", newcomer=True)
    wait_for_frames(page)
    expect(page.get_by_text("The link sets mode to “film”")).to_be_visible()
    expect(page.get_by_text(HINT)).to_be_visible()
    for width in (820, 1000, 1200, 1440):
        resize(page, {"width": width, "height": 700})
        expect_apart(page.locator(".status-line, .hint-line"))


def test_the_lab_is_loaded_when_it_is_opened_and_stays_open(open_page: OpenPage) -> None:
    page = open_page(SCENE, newcomer=True)
    wait_for_frames(page)

    def loaded(chunk: str) -> bool:
        return any(name.startswith(f"{chunk}-") for name in page.evaluate(CHUNKS))

    lab = ("panels", "side-figures", "help", "experiment-dialog", "plots")
    parts = (*lab, "view-menu", "streamed-source", "packager", "renderer")
    assert not any(loaded(chunk) for chunk in parts)
    page.get_by_role("button", name="Lab", exact=True).click()
    expect(page.get_by_role("heading", name="Lens")).to_be_visible()
    expect(page.get_by_role("region", name="Measurements")).to_be_visible()
    expect(page.get_by_text(HINT)).to_be_visible()
    for width, height in (1000, 640), (1440, 900), (1920, 1080):
        resize(page, {"width": width, "height": height})
        expect_apart(page.locator(".hud, .hint-line"))
    page.reload()
    wait_for_frames(page)
    expect(page.get_by_role("heading", name="Lens")).to_be_visible()


def test_a_part_that_the_server_no_longer_has_says_so(open_page: OpenPage) -> None:
    page = open_page(SCENE, newcomer=True, expected_errors="404")
    wait_for_frames(page)
    page.route("**/assets/panels-*.js", lambda route: route.fulfill(status=404))
    page.get_by_role("button", name="Lab", exact=True).click()
    expect(page.get_by_text("This part of the page could not be loaded.")).to_be_visible()
    expect(page.get_by_role("alert")).to_contain_text("TIGAS was updated on the server.")
