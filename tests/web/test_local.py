"""The mode that downloads the scene and draws it in the browser."""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, Route, ViewportSize, expect

from tests.render.scenes import made_up
from tests.web.conftest import PATIENCE, OpenPage
from tests.web.modes import with_settings
from tests.web.scenes import write_antialiased_scene
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames_pass, hold, kept, wait_for_frames, wait_until_settled
from tests.web.warp.views import psnr
from tigas_experiments.wire.recording import Recording

SMALL: ViewportSize = {"width": 320, "height": 240}
ALONE = {"sidebar": False, "hud": False, "refine": False, "reprojection": False, "prediction": "off"}
SLOW_NETWORK = {"offline": False, "latency": 0, "downloadThroughput": 300_000, "uploadThroughput": -1}
ALIKE_DB, ANOTHER_DB = 28.0, 16.0
"""Minimum similarity of two renderers' pictures of one view; two views are less similar."""
MOVEMENT = [
    {"t_ms": t, "position": [t / 5000, 0, 0], "quaternion": [0, math.sin(t / 4000), 0, math.cos(t / 4000)]}
    for t in range(0, 1001, 50)
]


def test_a_downloaded_scene_is_drawn_as_the_server_draws_it(open_page: OpenPage, server: RenderServer) -> None:
    page = open_page(SCENE, viewport=SMALL, **with_settings(server.url, **ALONE, controller="fixed", profile=0))
    wait_for_frames(page)
    page.wait_for_function("() => tigas.state().ready")
    first = recorded(page, download=True)
    assert first.local is not None
    assert first.local.began_ms >= 0
    wait_until_complete(page)
    page.wait_for_function("() => tigas.state().ready")

    recording = recorded(page)
    assert recording.local is not None
    assert recording.local.first_picture_ms is not None
    assert recording.local.complete_ms is not None
    assert 0 < recording.local.first_picture_ms <= recording.local.complete_ms
    assert recording.local.downloaded_bytes == recording.local.bytes > 0
    assert first.traffic[-1].bytes <= first.local.downloaded_bytes
    assert recording.traffic[-1].bytes == 0
    assert {frame.side for frame in (*first.frames, *recording.frames)} == {"local"}
    assert recording.frames[-1].pose == recording.inputs[-1].pose
    assert len({frame.pose for frame in recording.frames}) == len(recording.frames)
    captured = [np.asarray(kept(page, index).convert("RGB")) for index in range(len(recording.captures))]
    assert len(captured) >= 2
    assert all(picture.mean() > 20 for picture in captured), "a kept picture is empty"

    drawn = shown(page)
    page.evaluate("tigas.settings({ mode: 'stateless' })")
    expect(page.locator("canvas.local")).to_have_count(0)
    wait_for_frames(page)
    wait_until_settled(page)
    wait_until_like(page, drawn)
    hold(page, "ArrowRight")
    wait_until_settled(page)
    assert psnr(drawn, shown(page)) < ANOTHER_DB


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RenderServer]:
    """A render service with a scene of several levels of detail, and an antialiased one."""
    folder = tmp_path_factory.mktemp("models")
    made_up.unzip(folder / "levels", "shell.streamed.zip")
    write_antialiased_scene(folder)
    with RenderServer("--scenes", str(folder)) as running:
        yield running


def drawn_by(
    renderer: RenderServer, scene: str, open_page: OpenPage, *, expected_errors: str | None = None
) -> tuple[Page, NDArray[np.float64]]:
    """The viewer of a scene, and the server's view in it."""
    chosen = with_settings(renderer.url, **ALONE, controller="fixed", profile=0, webp=False)
    page = open_page(f"#/scene/{scene}", url=renderer.url, viewport=SMALL, expected_errors=expected_errors, **chosen)
    wait_for_frames(page)
    wait_until_settled(page)
    return page, shown(page)


def test_levels_of_detail_are_streamed_and_drawn_as_the_server_draws_them(
    renderer: RenderServer, open_page: OpenPage
) -> None:
    page, drawn = drawn_by(renderer, "levels", open_page, expected_errors="net::ERR_FAILED")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.route("**/download/streamed/*/**", lambda route: route.abort(), times=4)  # as if the service started again
    page.evaluate("tigas.settings({ mode: 'local' })")
    wait_until_complete(page)
    wait_until_like(page, drawn)
    assert any("/download/streamed/" in url and url.endswith(".webp") for url in asked)
    assert not any("/download/compressed" in url for url in asked)


def test_the_coarsest_level_is_in_the_picture_before_a_finer_one_loads(
    renderer: RenderServer, open_page: OpenPage
) -> None:
    page, drawn = drawn_by(renderer, "levels", open_page)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    held: dict[str, Route] = {}
    page.route("**/1_0/sh0.webp", lambda route: held.update(coarsest=route))
    page.route("**/0_0/meta.json", lambda route: held.update(finer=route))
    with page.expect_event("requestfinished", lambda request: request.url.endswith("/env/sh0.webp")):
        page.evaluate("tigas.settings({ mode: 'local' })")
    frames_pass(page, 20)
    assert "coarsest" in held
    assert not any("/0_0/" in url for url in asked), "a finer level loads at the same time"

    with page.expect_request("**/0_0/meta.json"):
        held["coarsest"].continue_()
    expect(page.locator("canvas.local")).to_have_count(1)
    assert psnr(drawn, shown(page)) > ANOTHER_DB
    held["finer"].continue_()
    wait_until_complete(page)
    wait_until_like(page, drawn)


def test_an_antialiased_scene_that_arrives_in_parts_is_drawn_with_its_filter(
    renderer: RenderServer, open_page: OpenPage
) -> None:
    page, drawn = drawn_by(renderer, "sand", open_page)
    network = page.context.new_cdp_session(page)
    network.send("Network.enable")
    network.send("Network.emulateNetworkConditions", SLOW_NETWORK)
    page.evaluate("tigas.settings({ mode: 'local' })")
    wait_until_complete(page)
    wait_until_like(page, drawn)


def recorded(page: Page, **changes: object) -> Recording:
    """The movement, played in the page."""
    plan = {"points": MOVEMENT, "duration_ms": 1000, "capture_every_ms": 400, "sample_stride": 0, **changes}
    return Recording.model_validate_json(json.dumps(page.evaluate("plan => tigas.run(plan)", plan)))


def wait_until_complete(page: Page) -> None:
    """Until all of the scene is on the screen."""
    wait_until_settled(page)


def shown(page: Page) -> NDArray[np.float64]:
    """The stage below its toolbar: [height, width, 3]."""
    clip: Any = {"x": 8, "y": 80, "width": SMALL["width"] - 16, "height": SMALL["height"] - 88}
    with Image.open(io.BytesIO(page.screenshot(clip=clip))) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64)


def wait_until_like(page: Page, picture: NDArray[np.float64]) -> None:
    """Wait until the stage shows the same view as a picture. Sorting the Gaussians takes a moment."""
    deadline = time.monotonic() + PATIENCE / 1000
    while (similarity := psnr(picture, shown(page))) <= ALIKE_DB:
        assert time.monotonic() < deadline, f"PSNR is {similarity:.1f} dB"
        page.wait_for_timeout(100)
