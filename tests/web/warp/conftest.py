"""A page with SwiftShader for WebGL, with the warp."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from tests.web.bundle import bundled, open_with
from tests.web.conftest import CHROMIUM, CHROMIUM_ARGS
from tests.web.warp.views import Stage

WEBGL_ARGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

START = """async () => {
  const { Warp } = await import("/warp.js");
  window.bytes = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const text = (bytes) => btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
  window.begin = (distance) => {
    window.warp?.dispose();
    window.canvas = document.createElement("canvas");
    window.heard = [];
    const told = { onLost: () => heard.push("lost"), onRestored: () => heard.push("restored") };
    window.warp = new Warp(canvas, { distance: distance ?? Infinity, ...told });
    return warp.working;
  };
  window.take = async (png, view, depth) => {
    const bitmap = await createImageBitmap(new Blob([bytes(png)]));
    warp.take(bitmap, view, depth && { ...depth, codes: bytes(depth.codes) });
    bitmap.close();
  };
  window.surround = async (png, view) => {
    const bitmap = await createImageBitmap(new Blob([bytes(png)]));
    warp.surround(bitmap, view);
    bitmap.close();
  };
  window.draw = async (view, width, height) => {
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    warp.draw(view);
    const picture = await createImageBitmap(canvas);
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(picture, 0, 0);
    return text(context.getImageData(0, 0, width, height).data);
  };
}"""


@pytest.fixture(scope="session")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page with WebGL and the warp."""
    modules = {
        name: bundled(f"packages/{entry}.ts", tmp_path_factory.mktemp(name))
        for name, entry in (("warp", "viewer/reproject/warp"), ("depth", "client/frames/decode-depth"))
    }
    with browser.browser_type.launch(executable_path=CHROMIUM, args=[*CHROMIUM_ARGS, *WEBGL_ARGS]) as chromium:
        page = chromium.new_page()
        open_with(page, **modules)
        page.evaluate(START)
        yield page


@pytest.fixture
def stage(page: Page) -> Iterator[Stage]:
    """Where all without depth is infinitely far."""
    yield Stage(page, None)
    errors = page.evaluate("() => { const gl = canvas.getContext('webgl2'); return gl.getError(); }")
    assert errors == 0, "WebGL complains"
