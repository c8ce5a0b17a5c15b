"""What tests do with the modes: choose one before the page is opened, and wait until it plays."""

from __future__ import annotations

import json
from typing import Any

from playwright.sync_api import Page


def with_settings(url: str, **chosen: object) -> dict[str, Any]:
    """Options for `open_page`: a browser in which these settings were chosen at an earlier visit."""
    stored = [{"name": "tigas.settings", "value": json.dumps(chosen)}]
    return {"storage_state": {"cookies": [], "origins": [{"origin": url.rstrip("/"), "localStorage": stored}]}}


def dash_frames(page: Page) -> int:
    """How many frames of the present stream were shown."""
    return int(page.locator(".stage").get_attribute("data-dash-frames") or 0)


def wait_for_dash(page: Page, at_least: int = 1) -> None:
    """Until the stream plays and so many of its frames have been shown."""
    page.wait_for_function(
        """n => {
          const stage = document.querySelector('.stage')?.dataset;
          return stage?.dash === 'playing' && Number(stage.dashFrames) >= n;
        }""",
        arg=at_least,
    )
