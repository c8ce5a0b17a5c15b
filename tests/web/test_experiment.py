"""Experiments from the page: what they find and keep, what cancelling leaves, and what a missing store costs."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.web.conftest import STATIC, OpenPage
from tests.web.fake_shaper import FakeShaper
from tests.web.server import RenderServer, Store
from tests.web.stage import SCENE, frames, wait_for_frames

pytest.importorskip("tigas_shaper")

WALK = "# anchor: start\nt_ms,x,y,z,qx,qy,qz,qw\n" + "".join(
    f"{t},{t / 8000:.4f},0,{t / 8000:.4f},0,0,0,1\n" for t in range(0, 2001, 50)
)
FIGURES = ("p50", "p95", "interactive", "framesPerSecond", "meanHeight", "switches", "received")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, results: Path) -> Iterator[Store]:
    """The store as a user starts it, with one movement."""
    movements = tmp_path_factory.mktemp("movements")
    (movements / "walk.csv").write_text(WALK)
    with Store("--results", str(results), "--movements", str(movements)) as running:
        yield running


@pytest.fixture(scope="module")
def shaper() -> Iterator[FakeShaper]:
    with FakeShaper() as running:
        yield running


@pytest.fixture(scope="module")
def lab_url(models: Path, store: Store, shaper: FakeShaper) -> Iterator[str]:
    """The viewer of a render service that knows a store and a shaper."""
    if not STATIC.exists():
        pytest.skip("the web client is not built: cd web && npm ci && npm run build")
    services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": store.url, "shaper": shaper.url})}
    with RenderServer("--scenes", str(models), environment=services) as running:
        yield running.url


def test_two_controllers_are_compared_and_kept(
    open_page: OpenPage, lab_url: str, shaper: FakeShaper, results: Path
) -> None:
    page = open_page(SCENE, url=lab_url)
    wait_for_frames(page)
    adaptation = page.get_by_label("Adaptation")
    adaptation.select_option("l2a")
    page.locator(".stage").focus()
    page.keyboard.press("e")
    dialog = page.locator("dialog.experiment")
    fill(page, name="Two <b> controllers", movement="store/walk", seconds="1.5")
    dialog.get_by_role("combobox", name="Network").select_option("stairs")
    dialog.get_by_role("textbox", name="Round trip").fill("80")
    dialog.get_by_label("Save all files at the end").check()
    expect(dialog.locator("[data-experiment=estimate]")).to_contain_text("2 runs, about 0:19 min")
    shaper.asked.clear()
    with page.expect_download() as download:
        dialog.get_by_role("button", name="Start").click()
        expect(page.get_by_role("region", name="Experiment")).to_contain_text("Run 1 of 2 · Latency")
        expect(dialog).to_be_hidden()
        expect(page.get_by_role("region", name="Experiment")).to_contain_text("Warms up")
        page.keyboard.press("p")
        page.keyboard.press("m")
        assert page.locator(".viewer").get_attribute("data-sidebar") == "closed", "the input is not locked"
        expect(page.get_by_role("region", name="Experiment")).to_contain_text("Run 2 of 2 · Budget")

    expect(dialog.get_by_role("heading")).to_have_text("Two <b> controllers")
    rows = dialog.locator("tbody tr")
    expect(rows).to_have_count(2)
    for index, name in enumerate(("Latency", "Budget")):
        expect(rows.nth(index).get_by_role("rowheader")).to_have_text(name)
        figures = {figure: rows.nth(index).locator(f"[data-figure={figure}]").inner_text() for figure in FIGURES}
        assert "–" not in figures.values(), f"{name} lacks a figure: {figures}"
        assert 5 < float(figures["p50"]) < 5000
    expect(dialog.locator(".chart canvas")).to_have_count(2)

    with zipfile.ZipFile(download.value.path()) as archive:
        names = archive.namelist()
    assert sum(name.endswith("frames.ndjson") for name in names) == 2, names
    (folder,) = results.glob("*controllers*")
    run = json.loads(next(folder.glob("runs/*latency*/run.json")).read_text())
    assert run["status"] == "complete"
    network = run["configuration"]["network"]
    assert (network["name"], network["rtt_ms"]) == ("stairs", 80)
    assert run["configuration"]["movement"] == "walk"
    assert (next(folder.glob("runs/*latency*")) / "link.ndjson").read_text().count("\n") > 2, "the link was not watched"

    held = [
        ("/start", {"trace": "stairs", "loop": True, "delay_ms": 40}),
        ("/pause", {}),
        ("/seek", {"position_ms": 0}),
    ]
    assert shaper.asked == [*held, ("/seek", {"position_ms": 0}), ("/resume", {}), ("/stop", {})] * 2

    dialog.get_by_role("button", name="Close").click()
    expect(adaptation, "the person's settings are back").to_have_value("l2a")
    shown = frames(page)
    page.locator(".stage").focus()
    page.keyboard.press("ArrowRight", delay=200)
    wait_for_frames(page, shown + 1)
    page.keyboard.press("e")
    report = dialog.get_by_role("link", name="Report").get_attribute("href")
    assert report is not None
    assert "Two &lt;b&gt; controllers" in page.request.get(report).text()
    dialog.get_by_role("link", name="All experiments").click()
    row = page.get_by_role("row", name="Two <b> controllers")
    expect(row.get_by_role("cell").first).to_have_text("2")
    expect(row.get_by_role("link", name="Report")).to_have_attribute("href", report)


def test_what_fails_or_is_cancelled_is_marked_and_without_a_store_nothing_is_lost(
    open_page: OpenPage, models: Path, shaper: FakeShaper, tmp_path: Path
) -> None:
    if not STATIC.exists():
        pytest.skip("the web client is not built: cd web && npm ci && npm run build")
    file = tmp_path / "my walk.csv"
    file.write_text(WALK)
    (tmp_path / "broken.csv").write_text("t_ms,x\n1,2\n")
    services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": "http://127.0.0.1:9", "shaper": shaper.url})}
    with RenderServer("--scenes", str(models), environment=services) as running:
        page = open_page(SCENE, url=running.url, expected_errors="ERR_")
        wait_for_frames(page)
        page.get_by_role("toolbar").get_by_role("button", name="Experiment").click()
        dialog = page.locator("dialog.experiment")
        expect(dialog).to_contain_text("The store at http://127.0.0.1:9 does not answer")
        dialog.get_by_role("button", name="Start").click()
        expect(dialog.get_by_role("alert")).to_contain_text("Choose a movement.")
        movement = dialog.get_by_label("Movement file of the experiment")
        movement.set_input_files(tmp_path / "broken.csv")
        expect(dialog.get_by_role("alert")).to_contain_text("broken.csv")
        movement.set_input_files(file)
        fill(page, name="No store", movement="file/my walk.csv", seconds="1.5")
        dialog.get_by_role("combobox", name="Network").select_option("stairs")
        dialog.get_by_label("LoL+").check()
        dialog.get_by_role("button", name="Start").click()

        progress = page.get_by_role("region", name="Experiment")
        expect(progress).to_contain_text("Run 2 of 3 · Budget")
        expect(progress).to_contain_text("Plays the movement")
        page.set_viewport_size({"width": 900, "height": 640})
        expect(progress).to_contain_text("Run 3 of 3 · LoL+")
        page.get_by_role("button", name="Cancel").click()
        expect(dialog).to_contain_text("The results stay in this page.")
        expect(dialog.locator("tbody tr").nth(0).locator("[data-figure=p50]")).not_to_have_text("–")
        expect(dialog.get_by_role("listitem")).to_have_text(
            [
                "Run 2, Budget: Settings or the window's size were changed during the run.",
                "Run 3, LoL+: It was cancelled before its end.",
            ]
        )
        assert shaper.asked[-1] == ("/stop", {}), "the link was not given back"
        dialog.get_by_role("button", name="Close").click()
        page.get_by_role("link", name="Back to all scenes").click()
        page.get_by_role("link", name="Pebbles").first.click()
        page.get_by_role("toolbar").get_by_role("button", name="Experiment").click()
        expect(dialog.get_by_role("button", name="Discard, and begin anew"), "a visit lost results").to_be_visible()
        with page.expect_download() as download:
            dialog.get_by_role("button", name="Save as JSON").click()
        expect(dialog.get_by_role("button", name="New experiment")).to_be_visible()
    assert download.value.suggested_filename == "No-store.json"
    saved: dict[str, Any] = json.loads(download.value.path().read_text())
    assert saved["plan"]["movement"] == "my walk.csv"
    assert [run["status"] for run in saved["runs"]] == ["complete", "failed", "cancelled"]
    assert len(saved["runs"][0]["recording"]["frames"]) > 5
    assert saved["runs"][0]["configuration"]["width"] == 1000, "the sidebar was beside the stage"


def fill(page: Page, *, name: str, movement: str, seconds: str) -> None:
    """The form, as far as all tests fill it in."""
    page.get_by_role("textbox", name="Name").fill(name)
    page.get_by_role("combobox", name="Movement").select_option(movement)
    page.get_by_role("textbox", name="Each run lasts").fill(seconds)
