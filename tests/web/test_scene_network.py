"""A scene's own networks in the page give the pictures that PyTorch gives, in a real WebGPU."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page

from tests.enhance.networks import LADDER, random_networks, weights_file
from tests.prerequisites import WEBGPU
from tests.web.bundle import bundled, open_with
from tigas_enhance.network import Network

TOLERANCE = 2 / 255

Frame = NDArray[np.uint8]


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The model as the page has it, and nothing else of the page."""
    return bundled("packages/viewer/enhance/models/scene.ts", tmp_path_factory.mktemp("module"))


@pytest.fixture(scope="module")
def page(browser: Browser, module: str) -> Iterator[Page]:
    """A page with a device and the model."""
    chromium = browser.browser_type.launch(
        executable_path=shutil.which("chromium"), args=["--headless=new", "--no-sandbox", "--enable-unsafe-webgpu"]
    )
    page = chromium.new_page()
    open_with(page, module=module)
    if not page.evaluate("navigator.gpu?.requestAdapter().then((adapter) => adapter !== null)"):
        WEBGPU.skip()
    page.evaluate(START)
    yield page
    chromium.close()


START = """async () => {
  const adapter = await navigator.gpu.requestAdapter();
  const requiredFeatures = ["shader-f16"].filter((feature) => adapter.features.has(feature));
  const device = await adapter.requestDevice({ requiredFeatures });
  window.problems = [];
  device.onuncapturederror = ({ error }) => problems.push(error.message);
  const { SCENE } = await import("/module.js");
  const bytes = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  window.load = async (weights, ladder) => {
    window.loaded = await SCENE.load(device, bytes(weights).buffer, ladder);
  };
  const textures = new Map();
  window.enhance = async (pixels, width, height, rung) => {
    const key = `${width}x${height}`;
    const input = textures.get(key) ?? device.createTexture({
      size: [width, height], format: "rgba8unorm", usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST,
    });
    textures.set(key, input);
    device.queue.writeTexture({ texture: input }, bytes(pixels), { bytesPerRow: 4 * width }, [width, height]);
    const encoder = device.createCommandEncoder();
    const result = loaded.run(encoder, input, rung);
    if (result === input) return null;
    const bytesPerRow = 256 * Math.ceil((8 * result.width) / 256);
    const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
    const buffer = device.createBuffer({ size: bytesPerRow * result.height, usage });
    encoder.copyTextureToBuffer({ texture: result }, { buffer, bytesPerRow }, [result.width, result.height]);
    device.queue.submit([encoder.finish()]);
    await buffer.mapAsync(GPUMapMode.READ);
    const content = Array.from(new Uint8Array(buffer.getMappedRange()), (byte) => String.fromCharCode(byte)).join("");
    return { width: result.width, height: result.height, format: result.format, bytesPerRow, content: btoa(content) };
  };
}"""


def load(page: Page, networks: dict[int, Network]) -> None:
    ladder = [rung.model_dump() for rung in LADDER]
    page.evaluate(
        "([weights, ladder]) => load(weights, ladder)",
        [base64.b64encode(weights_file(networks)).decode(), ladder],
    )


def enhanced(page: Page, frame: Frame, rung: int | None) -> NDArray[np.float32] | None:
    """[H, W, 3]; nothing if the page hands the frame on as it is."""
    height, width = frame.shape[:2]
    pixels = np.dstack([frame, np.full((height, width), 255, np.uint8)])
    result: dict[str, Any] | None = page.evaluate(
        "([pixels, width, height, rung]) => enhance(pixels, width, height, rung)",
        [base64.b64encode(pixels.tobytes()).decode(), width, height, rung],
    )
    assert page.evaluate("problems") == []
    if result is None:
        return None
    assert result["format"] == "rgba16float"
    rows = np.frombuffer(base64.b64decode(result["content"]), np.float16).reshape(result["height"], -1, 4)
    return rows[:, : result["width"], :3].astype(np.float32)


def by_torch(network: Network, frame: Frame) -> NDArray[np.float32]:
    with torch.inference_mode():
        pictures = torch.from_numpy(frame).permute(2, 0, 1)[None] / 255
        result: NDArray[np.float32] = network(pictures)[0].permute(1, 2, 0).numpy()
    return result


def random_frame(width: int, height: int) -> Frame:
    return np.random.default_rng(width).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("scale", "layers", "channels"),
    [
        pytest.param(2, 5, 16, marks=pytest.mark.extended),
        pytest.param(1, 5, 16, marks=pytest.mark.extended),
        pytest.param(2, 3, 24, marks=pytest.mark.extended),
        (2, 2, 4),
    ],
    ids=lambda value: str(value),
)
def test_the_page_gives_pytorchs_pictures(page: Page, scale: int, layers: int, channels: int) -> None:
    networks = random_networks({2: scale}, layers, channels)
    load(page, networks)
    frame = random_frame(48, 27)
    outcome = enhanced(page, frame, 2)
    expected = by_torch(networks[2], frame)
    assert np.std(expected - by_torch(Network(scale), frame)) > 0.02, "the network should make a difference"
    assert outcome is not None
    assert outcome.shape == expected.shape
    assert np.abs(outcome - expected).max() < TOLERANCE


def test_each_rung_has_its_network_whatever_the_shape_of_its_frames(page: Page) -> None:
    networks = random_networks({1: 1, 3: 2}, layers=2, channels=4)
    load(page, networks)
    for rung, width, height in [(1, 33, 18), (3, 16, 9), (3, 9, 16), (1, 33, 18), (3, 16, 9), (3, 1, 1)]:
        frame = random_frame(width, height)
        outcome = enhanced(page, frame, rung)
        assert outcome is not None
        assert np.abs(outcome - by_torch(networks[rung], frame)).max() < TOLERANCE


@pytest.mark.parametrize("rung", [0, 2, None])
def test_frames_of_rungs_without_a_network_pass_through(page: Page, rung: int | None) -> None:
    load(page, random_networks({1: 1}, layers=2, channels=4))
    assert enhanced(page, random_frame(16, 9), rung) is None


def test_what_was_disposed_of_can_be_loaded_again(page: Page) -> None:
    networks = random_networks({1: 2}, layers=2, channels=4)
    frame = random_frame(16, 9)
    for _ in range(2):
        load(page, networks)
        outcome = enhanced(page, frame, 1)
        assert outcome is not None
        assert np.abs(outcome - by_torch(networks[1], frame)).max() < TOLERANCE
        page.evaluate("loaded.dispose()")
