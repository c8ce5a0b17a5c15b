"""Frames enhanced by the page, in a Chromium with SwiftShader as its GPU."""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from tests.enhance.networks import random_networks, weights_file
from tests.web.conftest import CHROMIUM, CHROMIUM_ARGS, OpenPage
from tests.web.modes import with_settings
from tests.web.scenes import SMALL as SMALL_SCENE
from tests.web.scenes import write_scenes
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, kept, picture, wait_for_frames, wait_until_settled

WEBGPU_ARGS = [
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
]
SMALL: ViewportSize = {"width": 160, "height": 90}
LARGE: ViewportSize = {"width": 480, "height": 270}
LOWEST_RUNG = {
    "controller": "fixed",
    "profile": 3,
    "refine": False,
    "webp": False,
    "sidebar": False,
    "transport": "fetch",
    "reprojection": False,
}
NOTE = "[data-stat=enhancement-note]"
KEEP_DEVICES = """
(() => {
  window.devices = [];
  if (!globalThis.GPUAdapter) return;
  const ask = GPUAdapter.prototype.requestDevice;
  GPUAdapter.prototype.requestDevice = async function (...asked) {
    const device = await ask.apply(this, asked);
    window.devices.push(device);
    return device;
  };
})();
"""
SLOW_DISPLAY = """
(() => {
  const ask = requestAnimationFrame.bind(window);
  window.requestAnimationFrame = (callback) => ask(() => setTimeout(() => ask(callback), 160));
})();
"""
"""About 6 frames a second: a processor that draws in software, on a machine with other work, keeps up with that."""


@pytest.fixture(scope="module")
def browser(browser: Browser) -> Iterator[Browser]:
    """One with WebGPU."""
    with browser.browser_type.launch(executable_path=CHROMIUM, args=[*CHROMIUM_ARGS, *WEBGPU_ARGS]) as enhancing:
        yield enhancing


def viewer(
    open_page: OpenPage,
    server: RenderServer,
    *,
    script: str = SLOW_DISPLAY,
    source: Image.Image | None = None,
    viewport: ViewportSize = SMALL,
    **settings: Any,
) -> Page:
    """With a frame on the screen, at the lowest rung; `window.devices` has the devices that it asks for.

    With a source, every frame is this picture.
    """
    chosen = with_settings(server.url, **(LOWEST_RUNG | settings))
    page = open_page(url="about:blank", viewport=viewport, turn=settings.get("reprojection", False), **chosen)
    page.add_init_script(KEEP_DEVICES + script)
    if source is not None:
        answer_with(page, source)
    page.goto(server.url + SCENE)
    wait_for_frames(page)
    return page


def wait_until_enhanced(page: Page) -> None:
    """Until an enhanced frame is on the screen, where the view stands still."""
    wait_for_canvases(page, 2)
    wait_until_settled(page)


def wait_for_canvases(page: Page, count: int) -> None:
    """The second is there while frames are enhanced."""
    shows = "n => document.querySelectorAll('.stage canvas:not(.reprojected)').length === n"
    page.wait_for_function(shows, arg=count)


ENHANCED_TO = """([width, height]) => [...document.querySelectorAll('.stage canvas:not(.reprojected)')]
    .some((canvas, i) => i === 1 && canvas.width === width && canvas.height === height)"""
"""Whether enhanced frames have a size."""


def shown(page: Page) -> NDArray[np.int16]:
    """The screen without loss: [height, width, 3]."""
    plan = {
        "points": [{"t_ms": 0, "position": [0, 0, 0], "quaternion": [0, 0, 0, 1]}],
        "duration_ms": 300,
        "capture_every_ms": 100,
    }
    page.evaluate("plan => tigas.run(plan)", plan)
    return np.asarray(kept(page, 0).convert("RGB"), dtype=np.int16)


def pattern(width: int, height: int) -> Image.Image:
    """Hard edges, fine lines, and noise."""
    y, x = np.mgrid[:height, :width]
    stripes = np.stack([(x // 7 + y // 5) % 2, (x + y) % 3 == 0, x / width], axis=2) * 255
    noise = np.random.default_rng(1).integers(0, 256, (height, width, 3))
    return Image.fromarray(np.where(x[..., None] < width // 2, stripes, noise).astype(np.uint8))


def answer_with(page: Page, source: Image.Image) -> None:
    """Have every frame be this picture."""
    png = io.BytesIO()
    source.save(png, "png")

    def answer(route: Route) -> None:
        route.fulfill(response=route.fetch(), body=png.getvalue(), content_type="image/png")

    page.route("**/render", answer)


def enhanced_page(open_page: OpenPage, server: RenderServer, source: Image.Image, **settings: Any) -> Page:
    """A large viewer that always receives this picture, with an enhanced one on the screen."""
    page = viewer(open_page, server, source=source, viewport=LARGE, **settings)
    wait_until_enhanced(page)
    return page


@pytest.mark.parametrize(
    ("name", "method"), [("bicubic", Image.Resampling.BICUBIC), ("lanczos", Image.Resampling.LANCZOS)]
)
def test_baselines_are_pillow_s(
    open_page: OpenPage,
    server: RenderServer,
    name: str,
    method: Literal[Image.Resampling.BICUBIC, Image.Resampling.LANCZOS],
) -> None:
    source = pattern(320, 180)
    page = enhanced_page(open_page, server, source, upscale=name)
    for width, height, box in (
        (480, 270, (0, 0, 320, 180)),
        (160, 90, (0, 0, 320, 180)),
        (150, 90, (10, 0, 310, 180)),  # excess width is cropped on both sides
    ):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(ENHANCED_TO, arg=[width, height])
        wait_until_settled(page)
        expected = np.asarray(source.resize((width, height), method, box=box), dtype=np.int16)
        difference = np.abs(shown(page) - expected)
        assert difference.max() <= 2, f"{(difference > 2).mean():.2%} of the values differ by up to {difference.max()}"


def test_the_enhanced_picture_is_what_is_turned(open_page: OpenPage, server: RenderServer) -> None:
    source = pattern(320, 180)
    page = enhanced_page(open_page, server, source, upscale="bicubic", reprojection=True)
    page.locator("canvas.reprojected").wait_for()
    expected = np.asarray(source.resize((480, 270), Image.Resampling.BICUBIC), dtype=np.int16)
    assert np.abs(shown(page) - expected).max() <= 2
    page.evaluate("() => tigas.settings({ upscale: 'off' })")
    wait_for_canvases(page, 1)
    plain = shown(page)
    assert plain.shape == (180, 320, 3)
    assert np.abs(plain - np.asarray(source, dtype=np.int16)).max() <= 1


@pytest.mark.extended
def test_a_scene_s_network_is_pytorch_s(open_page: OpenPage, tmp_path: Path) -> None:
    source = pattern(320, 180)
    networks = random_networks({3: 2}, layers=2, channels=4)
    write_scenes(tmp_path)
    digest = hashlib.sha256((tmp_path / SMALL_SCENE / "point_cloud.ply").read_bytes()).hexdigest()
    (tmp_path / SMALL_SCENE / "enhance.safetensors").write_bytes(weights_file(networks, scene_sha256=digest))
    with RenderServer("--scenes", str(tmp_path)) as server:
        page = enhanced_page(open_page, server, source, upscale="scene")
        enlarged = shown(page)
        page.close()
    with torch.inference_mode():
        pictures = torch.from_numpy(np.array(source)).permute(2, 0, 1)[None] / 255
        enhanced = (255 * networks[3](pictures)).round().to(torch.uint8)[0].permute(1, 2, 0).numpy()
    expected = Image.fromarray(enhanced).resize((480, 270), Image.Resampling.BICUBIC)
    difference = np.abs(enlarged - np.asarray(expected, dtype=np.int16))
    assert difference.max() <= 2, f"{(difference > 2).mean():.2%} of the values differ by up to {difference.max()}"


def test_models_are_swapped_while_walking_and_the_hud_names_them_and_their_time(
    open_page: OpenPage, server: RenderServer
) -> None:
    page = viewer(open_page, server, upscale="bicubic", hudDetails=True)
    wait_until_enhanced(page)
    page.keyboard.down("ArrowRight")
    page.wait_for_function("() => parseFloat(document.querySelector('[data-stat=enhancement-time]').textContent) > 0")
    for name in ("lanczos", "off", "bicubic"):
        page.evaluate("upscale => tigas.settings({ upscale })", name)
        before = frames(page)
        wait_for_frames(page, before + 5)
        wait_for_canvases(page, 1 if name == "off" else 2)
        assert picture(page).std() > 10, "the picture is blank"
    page.keyboard.up("ArrowRight")
    expect(page.locator("[data-stat=enhancement]")).to_have_text("Bicubic")
    expect(page.locator(NOTE)).to_have_count(0)


def test_a_lost_device_is_asked_for_again_once(open_page: OpenPage, server: RenderServer) -> None:
    page = viewer(open_page, server, upscale="bicubic")
    wait_until_enhanced(page)
    page.keyboard.down("ArrowRight")
    page.evaluate("() => window.devices.at(-1).destroy()")
    page.wait_for_function("() => window.devices.length === 2")
    wait_for_frames(page, frames(page) + 3)
    wait_for_canvases(page, 2)
    expect(page.locator(NOTE)).to_have_count(0)
    page.evaluate("() => window.devices.at(-1).destroy()")
    expect(page.locator(NOTE)).to_have_text("Enhancement is off. The graphics processor was lost again.")
    wait_for_frames(page, frames(page) + 3)
    page.keyboard.up("ArrowRight")
    assert picture(page).std() > 10, "the picture is blank"
    assert page.evaluate("() => window.devices.length") == 2
    page.evaluate("() => tigas.settings({ upscale: 'lanczos' })")
    wait_for_canvases(page, 2)


BREAK_SHADERS = """
GPUDevice.prototype.createShaderModule = ((make) => function (parts) {
  return make.call(this, { ...parts, code: "no shader" });
})(GPUDevice.prototype.createShaderModule);
"""


def test_a_shader_that_the_device_refuses_ends_enhancement(open_page: OpenPage, server: RenderServer) -> None:
    page = viewer(open_page, server, script=BREAK_SHADERS, upscale="bicubic")
    expect(page.locator(NOTE)).to_contain_text("Enhancement is off. Bicubic failed: ")
    wait_for_canvases(page, 1)
    wait_until_settled(page)
    assert picture(page).std() > 10, "the picture is blank"


def test_a_window_that_is_resized_while_walking_stays_enhanced(open_page: OpenPage, server: RenderServer) -> None:
    page = viewer(open_page, server, upscale="bicubic")
    wait_until_enhanced(page)
    page.keyboard.down("ArrowRight")
    for width in range(100, 180, 5):
        page.set_viewport_size({"width": width, "height": 90})
        wait_for_frames(page, frames(page) + 1)
    page.keyboard.up("ArrowRight")
    page.wait_for_function(ENHANCED_TO, arg=[175, 90])
    wait_until_settled(page)
    expect(page.locator(NOTE)).to_have_count(0)
    assert shown(page).shape == (90, 175, 3)


def test_a_recording_says_what_enhancement_took_and_samples_what_was_on_the_screen(
    open_page: OpenPage, server: RenderServer
) -> None:
    page = viewer(open_page, server, upscale="bicubic")
    wait_until_enhanced(page)
    points = [{"t_ms": t, "position": [0, 0, 0], "quaternion": [0, t / 1000, 0, 1]} for t in (0, 1000)]
    plan = {"points": points, "duration_ms": 1000, "capture_every_ms": 0, "sample_stride": 4}
    recording, told = page.evaluate("async plan => [await tigas.run(plan), await tigas.samples()]", plan)
    recorded = [frame for frame in recording["frames"] if frame["enhance_ms"] is not None]
    assert recorded
    assert {(frame["shown_width"], frame["shown_height"]) for frame in recorded} == {(160, 90)}
    assert all(frame["enhance_ms"] > 0 for frame in recorded)
    assert any(frame["latencies"] for frame in recorded)
    enhanced = [sample for sample in told["samples"] if sample["enhanced"]]
    assert enhanced
    assert {(sample["upscale"], sample["width"], sample["height"]) for sample in enhanced} == {("bicubic", 160, 90)}
    for sample in enhanced[:5]:
        jpeg, png = (
            Image.open(io.BytesIO(base64.b64decode(page.evaluate("name => tigas.samplePicture(name)", name))))
            for name in (f"{sample['seq']:06}.jpg", f"{sample['seq']:06}.enhanced.png")
        )
        expected = np.asarray(jpeg.resize((160, 90), Image.Resampling.BICUBIC), dtype=np.int16)
        found = np.asarray(png.convert("RGB"), dtype=np.int16)
        assert np.abs(found - expected).mean() < 1, "it is of another frame"


def test_the_panel_chooses_models_and_tells_how_they_do(open_page: OpenPage, server: RenderServer) -> None:
    page = viewer(open_page, server)

    def loaded(route: Route) -> None:
        response = route.fetch()
        route.fulfill(response=response, json=response.json() | {"enhance": None})

    page.route("**/scenes/pebbles/load", loaded)
    page.reload()
    wait_for_frames(page)
    page.set_viewport_size({"width": 460, "height": 120})
    page.evaluate("() => tigas.settings({ sidebar: true })")
    page.get_by_label("Upscale").select_option("Bicubic")
    expect(page.locator("[data-enhancement=on]")).to_contain_text("On")
    wait_until_enhanced(page)
    page.get_by_label("Upscale").select_option("Scene-tuned network")
    expect(page.locator("[data-enhancement=failed]")).to_have_text(
        "Enhancement is off. Scene-tuned network cannot be used: there are no weights for this scene."
    )
    wait_for_canvases(page, 1)


def test_without_webgpu_the_panel_says_so(open_page: OpenPage, server: RenderServer) -> None:
    page = open_page(url="about:blank", **with_settings(server.url, upscale="bicubic", sidebar=True))
    page.add_init_script("delete Navigator.prototype.gpu")
    page.goto(server.url + SCENE)
    wait_for_frames(page)
    expect(page.locator("[data-enhancement=missing]")).to_have_text(
        "This browser has no WebGPU. Frames are shown without enhancement."
    )
    expect(page.get_by_label("Upscale")).to_be_disabled()
    assert page.locator(".stage canvas:not(.reprojected)").count() == 1
