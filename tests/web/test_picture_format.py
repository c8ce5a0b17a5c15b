"""Pictures come as WebP over a link that is slow enough for it, and the page shows them."""

from __future__ import annotations

import base64

import numpy as np
from playwright.sync_api import Browser, Response

from tests.render.encode.pictures import gradient
from tests.web.conftest import OpenPage
from tests.web.modes import with_settings
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, picture, wait_for_frames
from tigas_render.encode.depth_segment import encode_depth, insert_depth
from tigas_render.encode.images import encode_webp

KILOBYTES_PER_S = 120


def is_webp(answer: Response) -> bool:
    return answer.url.endswith("/render") and answer.headers.get("content-type") == "image/webp"


def test_over_a_slow_link_pictures_come_as_webp(open_page: OpenPage, server: RenderServer) -> None:
    chosen = {"controller": "fixed", "profile": 2, "refine": False, "surround": False, "transport": "fetch"}
    viewer = open_page(SCENE, **with_settings(server.url, **chosen), viewport={"width": 640, "height": 360})
    wait_for_frames(viewer)
    network = viewer.context.new_cdp_session(viewer)
    slow = {"offline": False, "latency": 0, "downloadThroughput": KILOBYTES_PER_S * 1000, "uploadThroughput": -1}
    network.send("Network.emulateNetworkConditions", slow)
    with viewer.expect_response(is_webp):
        viewer.keyboard.down("ArrowRight")
    shown = frames(viewer)
    wait_for_frames(viewer, shown + 1)
    viewer.keyboard.up("ArrowRight")
    assert picture(viewer).std() > 10, "the picture is blank"


def test_the_browser_decodes_a_webp_that_carries_a_depth(browser: Browser) -> None:
    deep = insert_depth(encode_webp(gradient(64, 36), 50), encode_depth(np.ones((9, 16), np.float32)))
    size = """async (content) => {
        const bytes = Uint8Array.from(atob(content), (each) => each.charCodeAt(0));
        const { width, height } = await createImageBitmap(new Blob([bytes], { type: "image/webp" }));
        return [width, height];
    }"""
    with browser.new_context() as context:
        page = context.new_page()
        assert page.evaluate(size, base64.b64encode(deep).decode()) == [64, 36]
