"""Helpers for experiments of the page: a viewer with a store and a fake shaper, and the completed form."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page

from tests.prerequisites import BUILT_PAGE
from tests.web.fake_shaper import FakeShaper
from tests.web.server import RenderServer, Store

STORED_MS = 90_000
"""How long the last run and its upload may take; the store's first check starts a process."""
TURN = "# anchor: start\nt_ms,x,y,z,qx,qy,qz,qw\n" + "".join(
    f"{t},0,0,0,0,{math.sin(t / 8000):.6f},0,{math.cos(t / 8000):.6f}\n" for t in range(0, 20_001, 50)
)
WALK = "# anchor: start\nt_ms,x,y,z,qx,qy,qz,qw\n" + "".join(
    f"{t},{t / 8000:.4f},0,{t / 8000:.4f},0,0,0,1\n" for t in range(0, 2001, 50)
)
MOVEMENTS = {"walk": WALK, "turn": TURN}


@dataclass(frozen=True)
class PageLab:
    """Services and their addresses."""

    url: str
    shaper: FakeShaper
    results: Path

    def runs(self, folder: str) -> dict[str, Any]:
        """Records of each run of experiments with this name, by profile."""
        found = [json.loads(path.read_text()) for path in self.results.glob(f"{folder}/runs/*/run.json")]
        by_profile = {run["configuration"]["profile"]: run for run in found}
        assert len(by_profile) == len(found), "a run was made twice"
        return by_profile


@contextmanager
def page_lab(models: Path, directory: Path) -> Iterator[PageLab]:
    """The viewer of a render service that knows a store, with movements, and a shaper."""
    BUILT_PAGE.require()
    movements, results = directory / "movements", directory / "results"
    movements.mkdir()
    results.mkdir()
    for name, text in MOVEMENTS.items():
        (movements / f"{name}.csv").write_text(text)
    store = Store("--results", str(results), movements=movements)
    with FakeShaper() as shaper:
        services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": store.url, "shaper": shaper.url})}
        with RenderServer("--scenes", str(models), environment=services) as render:
            store.configure(render=render.url)
            with store:
                yield PageLab(render.url, shaper, results)


def dialog(page: Page) -> Locator:
    """The experiment's dialog."""
    return page.locator("dialog.experiment")


def progress(page: Page) -> Locator:
    """The display of a running experiment."""
    return page.get_by_role("region", name="Experiment")


outcome = progress
"""The display of an experiment that has ended, in the same place."""


def fill(page: Page, *, name: str, movement: str, seconds: str, network: str = "") -> None:
    """Open the form and fill it in, as far as all tests do: frames as they come, which software keeps up with."""
    page.locator(".stage").focus()
    page.keyboard.press("x")
    form = dialog(page)
    form.get_by_role("checkbox", name="Reprojection", exact=True).uncheck()
    form.get_by_role("combobox", name="Prediction").select_option("off")
    form.get_by_role("textbox", name="Name").fill(name)
    form.get_by_role("combobox", name="Movement").select_option(movement)
    form.get_by_role("textbox", name="Run duration").fill(seconds)
    form.get_by_role("combobox", name="Network").select_option(network)


def start(page: Page) -> None:
    """Press the form's button."""
    dialog(page).get_by_role("button", name="Start").click()


def remarks(page: Page) -> Locator:
    """Notices about single runs."""
    return page.get_by_role("listitem")
