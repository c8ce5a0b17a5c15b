"""Disturbances of a run of the page's experiments are noticed, and the other runs continue."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.experiments import PageLab, fill, page_lab, remarks
from tests.web.stage import SCENE, wait_for_frames

HIDE = """() => {
  const draw = window.requestAnimationFrame;
  const waiting = [];
  const see = (state) => {
    Object.defineProperty(document, "visibilityState", { value: state, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  };
  window.requestAnimationFrame = (callback) => waiting.push(callback);
  window.show = () => {
    window.requestAnimationFrame = draw;
    waiting.forEach((callback) => draw(callback));
    see("visible");
  };
  see("hidden");
}"""
"""As a browser does with a tab that is in the background: it gets no animation frames. `show()` brings it back."""


@pytest.fixture(scope="module")
def lab(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageLab]:
    """A viewer with a store and a shaper."""
    with page_lab(models, tmp_path_factory.mktemp("lab")) as running:
        yield running


def begun(page: Page, *, name: str, network: str) -> None:
    """An experiment of three runs of three seconds, the first of which plays."""
    wait_for_frames(page)
    page.locator(".stage").focus()
    page.keyboard.press("x")
    dialog = page.locator("dialog.experiment")
    fill(page, name=name, movement="store/walk", seconds="3")
    dialog.get_by_role("combobox", name="Network").select_option(network)
    dialog.get_by_label("LoL+").check()
    dialog.get_by_role("button", name="Start").click()
    wait_until_played(page, "Run 1 of 3 · Latency")


def wait_until_played(page: Page, run: str) -> None:
    progress = page.get_by_role("region", name="Experiment")
    expect(progress).to_contain_text(run)
    expect(progress).to_contain_text("Plays the movement")


@pytest.mark.slow
@pytest.mark.extended
def test_somebody_else_at_the_link_and_a_hidden_page_spoil_a_run(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    begun(page, name="Disturbed", network="stairs")
    assert page.request.post(f"{lab.shaper.url}/seek", data={"position_ms": 15_000}).ok
    wait_until_played(page, "Run 2 of 3 · Budget")
    page.evaluate(HIDE)
    page.wait_for_timeout(1500)
    page.evaluate("show()")
    expect(page.get_by_role("region", name="Experiment")).to_contain_text("Run 3 of 3 · LoL+")

    dialog = page.locator("dialog.experiment")
    expect(remarks(dialog)).to_have_text(
        [
            "Run 1, Latency: The link was changed from outside during the run.",
            "Run 2, Budget: The page was hidden, so that not all of the run could be shown.",
        ]
    )
    assert list(lab.runs("Disturbed-*")) == ["lol+"]


def test_the_link_as_it_is_must_stay_as_it_is(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    begun(page, name="As it is", network="")
    link = {"down_kbps": 5000, "up_kbps": 5000}
    assert page.request.post(f"{lab.shaper.url}/link", data=link).ok
    changed = "The link is not 100mbit,50mbit-up any more, as it was when the experiment began."
    expect(remarks(page.locator("dialog.experiment"))).to_have_text(
        [
            "Run 1, Latency: The link was changed from outside during the run.",
            f"Run 2, Budget: {changed}",
            f"Run 3, LoL+: {changed}",
        ]
    )
    assert lab.runs("As-it-is-*") == {}
    assert page.request.post(f"{lab.shaper.url}/stop", data={}).ok
