"""Reads the camera's direction of a picture from the screen, independently of the viewer's reports."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page

from tests.web.stamping import ROUNDING

# Runs before the viewer's own code, and so at the start of each animation frame: the contents of a canvas or a video
# are then those on screen since the previous frame.
_WATCH = """
(() => {
  const CELLS = 32, SIDE = 4, WIDTH = CELLS * SIDE;
  const small = new OffscreenCanvas(WIDTH, SIDE).getContext("2d", { willReadFrequently: true });
  const read = (source) => {
    if (!source?.clientWidth) return null;
    small.drawImage(source, 0, 0, WIDTH, (WIDTH * source.clientHeight) / source.clientWidth);
    const { data } = small.getImageData(0, SIDE / 2, WIDTH, 1);
    const cells = Array.from({ length: CELLS }, (_, i) => Number(data[4 * (i * SIDE + SIDE / 2) + 1] > 127));
    const bits = (from, to) => cells.slice(from, to).reduce((sum, cell) => sum * 2 + cell, 0);
    const number = bits(4, 28);
    let check = 0;
    for (let rest = number; rest > 0; rest = Math.floor(rest / 16)) check ^= rest % 16;
    return bits(0, 4) === 0b1010 && check === bits(28, 32) ? number : null;
  };
  window.seen = { canvas: [], video: [] };
  const look = () => {
    requestAnimationFrame(look);
    const at = performance.now();
    window.seen.canvas.push([at, read(document.querySelector(".stage canvas"))]);
    window.seen.video.push([at, read(document.querySelector(".stage video"))]);
  };
  requestAnimationFrame(look);
})();
"""

Seen = list[tuple[float, int | None]]
"""At each animation frame: its time on the page's clock in milliseconds, and the heading that the screen shows."""


def watch_screen(page: Page) -> None:
    """Read both sides at each animation frame from now on, in this page's next document."""
    page.add_init_script(_WATCH)


def seen(page: Page, mode: str) -> Seen:
    """Observations of a mode's picture so far."""
    rows: list[list[Any]] = page.evaluate("kind => window.seen[kind]", "canvas" if mode == "stateless" else "video")
    return [(at, number) for at, number in rows]


def first_shown(rows: Seen, heading: int) -> float | None:
    """When the screen of a camera that turns to the right first showed this heading or a later one; None: never."""
    return next((at for at, number in rows if number is not None and number >= heading - ROUNDING), None)
