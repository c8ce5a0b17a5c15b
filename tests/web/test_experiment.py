"""Experiments from the page: results, records, cancelling, and a missing store."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.prerequisites import BUILT_PAGE
from tests.web.conftest import OpenPage
from tests.web.experiments import WALK, PageLab, fill, page_lab, remarks
from tests.web.fake_shaper import FakeShaper
from tests.web.server import RenderServer
from tests.web.stage import SCENE, frames, wait_for_frames
from tigas_experiments.run.parsing import parse_network
from tigas_experiments.wire.run import Network

FIGURES = ("p50", "p95", "interactive", "newViewsPerSecond", "meanHeight", "switches", "received")


@pytest.fixture(scope="module")
def lab(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageLab]:
    """A viewer with a store and a shaper."""
    with page_lab(models, tmp_path_factory.mktemp("lab")) as running:
        yield running


@pytest.fixture
def storeless(models: Path) -> Iterator[tuple[str, FakeShaper]]:
    """A viewer with an unreachable store, and its shaper."""
    BUILT_PAGE.require()
    with FakeShaper() as shaper:
        services = {"TIGAS_RENDER_SERVICES": json.dumps({"store": "http://127.0.0.1:9", "shaper": shaper.url})}
        with RenderServer("--scenes", str(models), environment=services) as running:
            yield running.url, shaper


def test_two_controllers_are_compared_and_kept(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    wait_for_frames(page)
    adaptation = page.get_by_label("Adaptation")
    adaptation.select_option("l2a")
    page.locator(".stage").focus()
    page.keyboard.press("x")
    dialog = page.locator("dialog.experiment")
    fill(page, name="Two <b> controllers", movement="store/walk", seconds="1.5")
    dialog.get_by_role("combobox", name="Network").select_option("stairs")
    dialog.get_by_role("textbox", name="Round trip").fill("80")
    dialog.get_by_label("Save all files at the end").check()
    expect(dialog.locator("[data-experiment=estimate]")).to_contain_text("2 runs, about 0:19 min")
    lab.shaper.asked.clear()
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
    (folder,) = lab.results.glob("*controllers*")
    run = lab.runs(folder.name)["latency"]
    assert run["status"] == "complete"
    network = run["configuration"]["network"]
    assert (network["trace"], network["rtt_ms"]) == ("stairs", 80)
    assert run["configuration"]["movement"] == "walk"
    assert (next(folder.glob("runs/*latency*")) / "link.ndjson").read_text().count("\n") > 2, "the link was not watched"

    held = [
        ("/start", {"trace": "stairs", "loop": True, "delay_ms": 40}),
        ("/pause", {}),
        ("/seek", {"position_ms": 0}),
    ]
    assert lab.shaper.asked == [*held, ("/seek", {"position_ms": 0}), ("/resume", {}), ("/stop", {})] * 2

    dialog.get_by_role("button", name="Close").click()
    expect(adaptation, "the person's settings are back").to_have_value("l2a")
    shown = frames(page)
    page.locator(".stage").focus()
    page.keyboard.press("ArrowRight", delay=200)
    wait_for_frames(page, shown + 1)
    page.keyboard.press("x")
    report = dialog.get_by_role("link", name="Report").get_attribute("href")
    assert report is not None
    assert "Two &lt;b&gt; controllers" in page.request.get(report).text()
    dialog.get_by_role("link", name="All experiments").click()
    row = page.get_by_role("row", name="Two <b> controllers")
    expect(row.get_by_role("cell").first).to_have_text("2")
    expect(row.get_by_role("link", name="Report")).to_have_attribute("href", report)


def test_what_fails_or_is_cancelled(storeless: tuple[str, FakeShaper], open_page: OpenPage, tmp_path: Path) -> None:
    url, shaper = storeless
    file = tmp_path / "my walk.csv"
    file.write_text(WALK)
    (tmp_path / "broken.csv").write_text("t_ms,x\n1,2\n")
    page = open_page(SCENE, url=url, expected_errors="ERR_")
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
    expect(remarks(dialog)).to_have_text(
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
    expect(dialog.get_by_role("button", name="Discard and start over"), "a visit lost results").to_be_visible()
    with page.expect_download() as download:
        dialog.get_by_role("button", name="Save as JSON").click()
    expect(dialog.get_by_role("button", name="New experiment")).to_be_visible()
    assert download.value.suggested_filename == "No-store.json"
    saved: dict[str, Any] = json.loads(download.value.path().read_text())
    assert saved["plan"]["movement"] == "my walk.csv"
    assert [run["status"] for run in saved["runs"]] == ["complete", "failed", "cancelled"]
    assert len(saved["runs"][0]["recording"]["frames"]) > 5
    assert saved["runs"][0]["configuration"]["width"] == 1000, "the sidebar was beside the stage"


@pytest.mark.parametrize(
    ("field", "typed", "sentence"),
    [
        ("Name", " ", "The experiment needs a name."),
        ("Runs of each", "", "“Runs of each” must be a whole number from 1 to 100."),
        ("Runs of each", "two", "“Runs of each” must be a whole number from 1 to 100."),
        ("Runs of each", "101", "“Runs of each” must be a whole number from 1 to 100."),
        ("Each run lasts", "0.5", "“Each run lasts” must be a number from 1 to 7,200 s."),
    ],
)
def test_a_field_that_makes_no_sense_is_named_and_nothing_is_started(
    open_page: OpenPage, tmp_path: Path, field: str, typed: str, sentence: str
) -> None:
    file = tmp_path / "walk.csv"
    file.write_text(WALK)
    page = open_page(SCENE)
    wait_for_frames(page)
    page.get_by_role("toolbar").get_by_role("button", name="Experiment").click()
    dialog = page.locator("dialog.experiment")
    dialog.get_by_label("Movement file of the experiment").set_input_files(file)
    expect(dialog.get_by_role("combobox", name="Movement")).to_have_value("file/walk.csv")
    expect(dialog.get_by_role("button", name="Start"), "it has to be looked for").to_be_in_viewport(ratio=1)
    dialog.get_by_role("textbox", name=field).fill(typed)
    dialog.get_by_role("button", name="Start").click()
    expect(dialog.get_by_role("alert")).to_have_text(sentence)
    expect(page.get_by_role("region", name="Experiment")).to_have_count(0)
    expect(dialog.get_by_role("textbox", name=field), "what was typed is lost").to_have_value(typed)
    dialog.get_by_role("textbox", name=field).fill("7")
    expect(dialog.get_by_text(sentence), "it is being mended").to_have_count(0)


@pytest.mark.slow
@pytest.mark.extended
def test_an_experiment_whose_page_was_closed_is_incomplete_and_gets_the_run_that_is_missing(
    open_page: OpenPage, lab: PageLab
) -> None:
    page = open_page(SCENE, url=lab.url)
    wait_for_frames(page)
    page.locator(".stage").focus()
    page.keyboard.press("x")
    fill(page, name="Closed", movement="store/walk", seconds="1.5")
    page.locator("dialog.experiment").get_by_role("button", name="Start").click()
    expect(page.get_by_role("region", name="Experiment")).to_contain_text("Run 2 of 2 · Budget")
    page.close()

    page = open_page("#/experiments", url=lab.url)
    row = page.get_by_role("row", name="Closed")
    expect(row.get_by_role("cell").first).to_have_text("1 of 2, incomplete")
    row.get_by_role("button", name="Continue").click()
    dialog = page.locator("dialog.experiment")
    expect(dialog.get_by_role("heading")).to_have_text("Closed")
    expect(dialog).to_contain_text(
        "1 of 2 runs are missing, with the movement walk over the network 100mbit,50mbit-up."
    )
    expect(dialog.get_by_role("combobox", name="Movement")).to_have_value("store/walk")
    dialog.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("region", name="Experiment")).to_contain_text("Run 1 of 1 · Budget")
    expect(dialog.locator("tbody tr").get_by_role("rowheader")).to_have_text("Budget")
    expect(remarks(dialog)).to_have_count(0)
    dialog.get_by_role("link", name="All experiments").click()
    expect(row.get_by_role("cell").first).to_have_text("2")
    expect(row.get_by_role("button", name="Continue")).to_have_count(0)

    runs = lab.runs("Closed-*")
    assert {profile: run["status"] for profile, run in runs.items()} == {"latency": "complete", "budget": "complete"}
    for run in runs.values():
        network = Network.model_validate(run["configuration"]["network"])
        assert network == parse_network("100mbit,50mbit-up"), "the link as it was"
