"""The view of `tigas.show` in a browser, as anywidget opens it: with the widget's model and an element of the cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

import tigas
from tests.web.bundle import open_with
from tests.web.conftest import LOOPBACK, OpenPage
from tests.web.server import RenderServer
from tests.web.test_examples import contrast

OPEN = """async (state) => {
  const listeners = new Map();
  const model = {
    get: (name) => state[name],
    set: (name, value) => {
      if (JSON.stringify(state[name]) === JSON.stringify(value)) return;
      state[name] = value;
      for (const listener of listeners.get(`change:${name}`) ?? []) listener();
    },
    on: (name, listener) => listeners.set(name, [...(listeners.get(name) ?? []), listener]),
    off: (name, listener) => listeners.set(name, listeners.get(name).filter((one) => one !== listener)),
    save_changes: () => undefined,
  };
  const el = document.body.appendChild(document.createElement("div"));
  const { default: widget } = await import("/widget.js");
  const close = await widget.render({ model, el });
  Object.assign(window, { model, close, shortcuts: [] });
  document.addEventListener("keydown", ({ code }) => window.shortcuts.push(code));
}"""
"""The keydown listener is a notebook's, with its shortcuts."""

OpenCell = Callable[..., Page]


@pytest.fixture
def open_cell(open_page: OpenPage, server: RenderServer) -> OpenCell:
    """Opens a page with a viewer of the scene under test."""

    def open_(**options: Any) -> Page:
        viewer = tigas.show("pebbles", server=server.url)
        page = open_page(url="about:blank", permissions=LOOPBACK, **options)
        open_with(page, widget=viewer.get_state("_esm")["_esm"])
        page.evaluate(OPEN, viewer.get_state(["server", "scene", "mode", "settings", "height", "_camera", "error"]))
        return page

    return open_


def camera(page: Page) -> Any:
    """The camera's pose as Python has it."""
    return page.evaluate("model.get('_camera')")


def test_the_cell_shows_the_scene_and_both_sides_move_the_camera(open_cell: OpenCell) -> None:
    page = open_cell()
    stage = page.locator(".stage")
    expect(stage).to_have_attribute("data-phase", "playing")
    page.wait_for_function("model.get('_camera') !== null")
    expect(stage).to_have_css("height", "480px")
    assert contrast(stage) > 10
    start = camera(page)
    stage.focus()
    page.keyboard.down("w")
    page.wait_for_function("start => String(model.get('_camera').position) !== String(start)", arg=start["position"])
    page.keyboard.up("w")
    assert page.evaluate("shortcuts") == []
    page.evaluate("start => model.set('_camera', start)", start)
    page.keyboard.down("ArrowLeft")
    turned = "start => String(model.get('_camera').quaternion) !== String(start)"
    page.wait_for_function(turned, arg=start["quaternion"])
    page.keyboard.up("ArrowLeft")
    assert camera(page)["position"] == pytest.approx(start["position"])


def test_the_cell_says_what_is_wrong_and_ends(open_cell: OpenCell) -> None:
    page = open_cell(expected_errors="404")
    expect(page.locator(".stage")).to_have_attribute("data-phase", "playing")
    page.evaluate("model.set('mode', 'magic')")
    expect(page.get_by_role("status")).to_have_text("mode has an invalid value")
    page.evaluate("model.set('mode', 'video')")
    expect(page.get_by_role("status")).to_have_text("")
    page.evaluate("model.set('scene', 'attic')")
    expect(page.get_by_role("status")).to_contain_text("no scene")
    assert "no scene" in page.evaluate("model.get('error')")
    page.evaluate("close()")
    expect(page.locator(".stage")).to_have_count(0)
