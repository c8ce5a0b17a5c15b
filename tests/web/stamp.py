"""Reads the camera's heading from the screen, independently of the viewer's reports."""

from __future__ import annotations

import numpy as np
from playwright.sync_api import Page

from tests.web.stamping import TOLERANCE, read_headings

# Runs before the viewer's own code, and so at the start of each animation frame: the contents of a canvas or a video
# are then those on screen since the previous frame.
_WATCH = """
(() => {
  const WIDTH = 256, HEIGHT = 4;
  const small = new OffscreenCanvas(WIDTH, HEIGHT).getContext("2d", { willReadFrequently: true });
  small.globalCompositeOperation = "copy"; // where a picture is transparent, nothing of the one before is left
  // As long as it is drawn, a canvas keeps its picture until the next animation frame, so the reading is of the screen.
  const getContext = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return getContext.call(this, kind, { ...options, preserveDrawingBuffer: true });
  };
  const shown = (selector) =>
    [...document.querySelectorAll(selector)].find((one) => one.checkVisibility({ visibilityProperty: true }));
  window.seen = [];
  const look = () => {
    requestAnimationFrame(look);
    const at = performance.now(), source = shown(".stage canvas") ?? shown(".stage video");
    if (!source) return;
    small.drawImage(source, 0, 0, WIDTH, HEIGHT);
    const { data } = small.getImageData(0, HEIGHT / 2, WIDTH, 1);
    window.seen.push([at, Array.from({ length: WIDTH }, (_, i) => (data[4 * i + 3] < 255 ? null : data[4 * i + 1]))]);
  };
  requestAnimationFrame(look);
})();
"""

Seen = list[tuple[float, float | None]]
"""At each animation frame: its time on the page's clock in milliseconds, and the heading that the screen shows."""


def watch_screen(page: Page) -> None:
    """Read the screen at each animation frame from now on, in this page's next document."""
    page.add_init_script(_WATCH)


def seen(page: Page, since: float) -> Seen:
    """Observations of the picture since a time."""
    rows = page.evaluate("since => window.seen.filter(([at]) => at >= since)", since)
    headings = read_headings(np.array([row for _, row in rows], np.float64))
    return [(at, heading) for (at, _), heading in zip(rows, headings, strict=True)]


def first_shown(rows: Seen, heading: float) -> tuple[float, float] | None:
    """When the screen of a camera that turns to the right first showed this heading or a later one, and how long the
    longer of the two frames around it took, at least that of a screen at 60 Hz; None: never.
    """
    for before, (at, shown), after in zip(rows, rows[1:], rows[2:], strict=False):
        if shown is not None and shown >= heading - TOLERANCE:
            return at, max(1000 / 60, at - before[0], after[0] - at)
    return None
