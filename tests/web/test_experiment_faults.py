"""Disturbances of a run of the page's experiments are noticed, and the other runs continue."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import OpenPage
from tests.web.experiments import STORED_MS, PageLab, dialog, fill, outcome, progress, remarks, start
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


def begun(page: Page, *, name: str, network: str) -> None:
    """An experiment of three runs of three seconds, the first of which plays."""
    wait_for_frames(page)
    fill(page, name=name, movement="store/long", seconds="3", network=network)
    dialog(page).get_by_label("LoL+").check()
    start(page)
    wait_until_played(page, "Run 1 of 3")


def wait_until_played(page: Page, run: str) -> None:
    expect(progress(page)).to_contain_text(run)
    expect(progress(page)).to_contain_text("Playing the movement")


CHANGED = "The link was changed from outside during the run."


@pytest.mark.slow
@pytest.mark.extended
def test_somebody_else_at_the_link_and_a_hidden_page_spoil_a_run(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    begun(page, name="Disturbed", network="stairs")
    assert page.request.post(f"{lab.shaper.url}/seek", data={"position_ms": 15_000}).ok
    expect(remarks(page)).to_have_count(1)
    expect(progress(page)).to_contain_text("Playing the movement")
    page.evaluate(HIDE)
    page.wait_for_timeout(1500)
    page.evaluate("show()")
    expect(outcome(page)).to_contain_text("2 runs are incomplete.", timeout=STORED_MS)
    expect(remarks(page).nth(0)).to_contain_text(CHANGED)
    expect(remarks(page).nth(1)).to_contain_text("The page was hidden during the run.")
    statuses = [run["status"] for run in lab.runs("Disturbed-*").values()]
    assert sorted(statuses) == ["complete", "failed", "failed"]


@pytest.mark.extended
def test_two_pages_share_an_experiment_and_a_link(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    begun(page, name="Shared", network="stairs")
    other = open_page(page.url.removeprefix(lab.url), url=lab.url)
    expect(progress(other)).to_contain_text("Waiting for other pages")
    page.close(run_before_unload=False)
    expect(outcome(other)).to_contain_text("All runs are complete.", timeout=STORED_MS)
    assert [run["status"] for run in lab.runs("Shared-*").values()] == ["complete"] * 3
