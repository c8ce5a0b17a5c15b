"""Pictures come as WebP over a link that is slow enough for it, and the page shows them."""

from __future__ import annotations

from playwright.sync_api import Response

from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, picture, wait_for_frames, wait_until_settled

KILOBYTES_PER_S = 60


def is_webp(answer: Response) -> bool:
    return answer.url.endswith("/render") and answer.headers.get("content-type") == "image/webp"


def test_over_a_slow_link_pictures_come_as_webp_with_their_depth(open_page: OpenPage, server: RenderServer) -> None:
    chosen = {"controller": "fixed", "profile": 2, "refine": False, "surround": False, "transport": "fetch"}
    viewer = open_page(**with_settings(server.url, **chosen), viewport={"width": 640, "height": 360})
    viewer.goto(server.url + SCENE)
    wait_for_frames(viewer)
    network = viewer.context.new_cdp_session(viewer)
    slow = {"offline": False, "latency": 0, "downloadThroughput": KILOBYTES_PER_S * 1000, "uploadThroughput": -1}
    network.send("Network.emulateNetworkConditions", slow)
    with viewer.expect_response(is_webp) as answer:
        viewer.keyboard.down("ArrowRight")
    shown = frames(viewer)
    wait_for_frames(viewer, shown + 2)
    viewer.keyboard.up("ArrowRight")
    wait_until_settled(viewer)
    assert b"TDEP" in answer.value.body()
    assert picture(viewer).std() > 10, "the picture is blank"
