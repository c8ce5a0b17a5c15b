"""Helpers for the viewer: wait for frames, look at the picture, read the HUD."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import FloatRect, Locator, Page, ViewportSize

from tests.web.conftest import PATIENCE

SCENE = "#/scene/pebbles"
OVERLAPPING = """(parts) => parts.flatMap((a, i) => parts.slice(i + 1).flatMap((b) => {
    const [p, q] = [a, b].map((part) => part.getBoundingClientRect());
    const apart = p.right <= q.left || q.right <= p.left || p.bottom <= q.top || q.bottom <= p.top;
    return apart ? [] : [`${a.className} and ${b.className}`];
}))"""
"""Pairs of elements of a locator that overlap."""


def frames(page: Page) -> int:
    """How many frames the viewer has shown."""
    return int(page.locator(".stage").get_attribute("data-frames") or 0)


def wait_for_frames(page: Page, at_least: int = 1) -> None:
    """Wait until this many frames have been shown."""
    page.wait_for_function("n => Number(document.querySelector('.stage')?.dataset.frames) >= n", arg=at_least)


def wait_until_settled(page: Page) -> None:
    """Until the newest view is on the screen."""
    page.wait_for_function("() => document.querySelector('.stage')?.dataset.settled === 'true'")


def hold(page: Page, key: str, *, views: int = 5) -> None:
    """Hold a key until the camera's way has been shown in so many views, however slow the machine is."""
    shown = frames(page)
    page.keyboard.down(key)
    wait_for_frames(page, shown + views)
    page.keyboard.up(key)


def resize(page: Page, size: ViewportSize) -> None:
    """Resize the window and wait until the page has drawn itself anew."""
    page.set_viewport_size(size)
    frames_pass(page, 2)


def frames_pass(page: Page, count: int) -> None:
    """Until so many animation frames have come."""
    page.evaluate(
        """count => new Promise((resolve) => {
          const next = () => (count-- > 0 ? requestAnimationFrame(next) : resolve());
          next();
        })""",
        count,
    )


def expect_apart(parts: Locator) -> None:
    """Wait until no two of the elements overlap."""
    deadline = time.monotonic() + PATIENCE / 1000
    while overlapping := parts.evaluate_all(OVERLAPPING):
        assert time.monotonic() < deadline, overlapping
        frames_pass(parts.page, 1)


def stat(page: Page, name: str) -> str:
    """One of the HUD's numbers, as text."""
    return page.locator(f"[data-stat={name}]").inner_text()


def picture(page: Page) -> NDArray[np.int16]:
    """The centre of the stage, free of overlays: [height, width, 3]."""
    return np.asarray(part(page, ".stage", (0.52, 0.3, 0.4, 0.35)), dtype=np.int16)


def part(page: Page, element: str, shares: tuple[float, float, float, float]) -> Image.Image:
    """A screenshot of a part of an element: left, top, width and height as shares of its own."""
    box = page.locator(element).bounding_box()
    assert box is not None
    left, top, width, height = shares
    clip: FloatRect = {
        "x": box["x"] + box["width"] * left,
        "y": box["y"] + box["height"] * top,
        "width": box["width"] * width,
        "height": box["height"] * height,
    }
    return Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")


def kept(page: Page, index: int) -> Image.Image:
    """A picture that the page's last run has kept."""
    png = page.evaluate("index => tigas.capture(index)", index)
    return Image.open(io.BytesIO(base64.b64decode(png)))


def changes(page: Page, act: Callable[[], object]) -> float:
    """Change of the picture by `act`: mean absolute difference, 0 to 255."""
    before, shown = picture(page), frames(page)
    act()
    wait_for_frames(page, shown + 1)
    wait_until_settled(page)
    return float(np.abs(picture(page) - before).mean())
