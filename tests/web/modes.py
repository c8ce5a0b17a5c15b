"""Helpers for modes: choose one before the page is opened, and wait until it plays."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from tests.eventually import wait_until
from tests.web.server import Packager


def with_settings(url: str, **chosen: object) -> dict[str, Any]:
    """Options for `open_page`: a browser in which these settings were chosen at an earlier visit."""
    stored = [{"name": "tigas.settings", "value": json.dumps(chosen)}]
    return {"storage_state": {"cookies": [], "origins": [{"origin": url.rstrip("/"), "localStorage": stored}]}}


def wait_for_stream(page: Page, at_least: int = 1) -> None:
    """Wait until the stream, which is the last picture on the stage, plays and has shown this many frames."""
    page.wait_for_function(
        """n => {
          const { sources = '', shown = '' } = document.querySelector('.stage')?.dataset ?? {};
          return sources.split(' ').at(-1) === 'playing' && Number(shown.split(' ').at(-1)) >= n;
        }""",
        arg=at_least,
    )


def wait_for_sessions(packager: Packager, wanted: Callable[[list[dict[str, Any]]], bool]) -> None:
    """Wait until the packager's streams are as wanted."""
    wait_until(lambda: wanted(packager.sessions()), 90)  # a page that did not say goodbye has a stream for a minute
