"""Helpers for movement traces in the page: files chosen by the user, and the camera's path."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, Request, expect

from tests.web.conftest import PATIENCE, OpenPage
from tests.web.modes import with_settings
from tests.web.stage import SCENE, wait_for_frames

HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n"
WALK = {"viewport": {"width": 1000, "height": 1100}}


def file(name: str, content: str | bytes) -> Any:
    """A file as a person chooses it."""
    return {"name": name, "mimeType": "text/csv", "buffer": content if isinstance(content, bytes) else content.encode()}


def turning_walk(duration_ms: int, *, name: str = "walk.csv") -> Any:
    """Along x, to 1 and quicker at first, while it turns to the right by an angle of x."""
    rows = []
    for t in range(0, duration_ms + 1, 25):
        x = np.sqrt(t / duration_ms)
        rows.append(f"{t},{x},0,0,0,{np.sin(x / 2)},0,{np.cos(x / 2)}\n")
    return file(name, f"# anchor: scene\n# description: A walk along x\n{HEADER}{''.join(rows)}")


class Poses:
    """The camera's path in the page's requests: positions and quaternions, in order."""

    def __init__(self, page: Page) -> None:
        self._asked: list[dict[str, Any]] = []
        page.on("request", self._on_request)

    def clear(self) -> None:
        """Forget them."""
        self._asked.clear()

    def __len__(self) -> int:
        return len(self._asked)

    @property
    def positions(self) -> NDArray[np.float64]:
        """[N, 3]"""
        return np.array([one["position"] for one in self._asked])

    @property
    def quaternions(self) -> NDArray[np.float64]:
        """[N, 4]"""
        return np.array([one["quaternion"] for one in self._asked])

    def _on_request(self, request: Request) -> None:
        if request.url.endswith("/render"):
            self._asked.append(json.loads(request.post_data or ""))


def opened(open_page: OpenPage, url: str, **options: Any) -> tuple[Page, Poses]:
    """A viewer with recorded requests, which reveal the camera; its settings are open."""
    as_they_come = {"reprojection": False, "prediction": "off"}
    chosen = with_settings(
        url, transport="fetch", controller="fixed", profile=3, refine=False, sidebar=True, **as_they_come
    )
    page = open_page(SCENE, url=url, **{**WALK, **chosen, **options})
    poses = Poses(page)
    wait_for_frames(page)
    return page, poses


def choose(page: Page, chosen: Any) -> None:
    """Open a file."""
    page.get_by_label("Movement file", exact=True).set_input_files(chosen)


def press(page: Page, name: str) -> None:
    """A button."""
    page.get_by_role("button", name=name, exact=True).click()


def expect_state(page: Page, state: str) -> None:
    """Wait until the movement is in it."""
    expect(page.locator("[data-movement]")).to_have_attribute("data-movement", state)


def wait_for_pose(page: Page, poses: Poses, position: tuple[float, float, float]) -> None:
    """Wait until the camera is there, up to the difference between a movement's chords and its curve."""
    wait_until_there(page, poses, lambda at: bool(np.abs(at - position).max() <= 1e-4))


def wait_until_there(page: Page, poses: Poses, there: Callable[[NDArray[np.float64]], bool]) -> None:
    """Wait until the camera's position is as wanted."""
    deadline = time.monotonic() + PATIENCE / 1000
    while not len(poses) or not there(poses.positions[-1]):
        assert time.monotonic() < deadline, f"the camera is at {poses.positions[-1:]}"
        page.wait_for_timeout(20)
