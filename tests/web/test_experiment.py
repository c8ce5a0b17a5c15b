"""Experiments from the page: planned by the store and performed here; and the command's twin."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.experiments.processes import finished, started
from tests.web.conftest import OpenPage
from tests.web.experiments import STORED_MS, WALK, PageLab, dialog, fill, outcome, progress, remarks, start
from tests.web.stage import SCENE, wait_for_frames
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.summary import summarise


@pytest.mark.extended
def test_two_controllers_are_compared_and_kept(open_page: OpenPage, lab: PageLab) -> None:
    page = open_page(SCENE, url=lab.url)
    wait_for_frames(page)
    page.get_by_label("Adaptation").select_option("l2a")
    fill(page, name="Two (b) controllers", movement="store/walk", seconds="1.5", network="stairs")
    dialog(page).get_by_role("textbox", name="Round trip").fill("80")
    expect(dialog(page).locator("[data-experiment=estimate]")).to_have_text("2 runs, about 13 seconds.")
    lab.shaper.asked.clear()
    start(page)
    expect(progress(page)).to_contain_text("Warming up", timeout=STORED_MS)
    expect(progress(page)).to_contain_text("Run 1 of 2")
    expect(page.locator(".run-stage .stage")).to_have_css("width", "1000px")
    expect(progress(page)).to_contain_text("Run 2 of 2")
    expect(outcome(page)).to_contain_text("All runs are complete.", timeout=STORED_MS)
    expect(remarks(page)).to_have_count(0)
    with page.expect_download() as download:
        outcome(page).get_by_role("link", name="Save as ZIP").click()
    with zipfile.ZipFile(download.value.path()) as archive:
        names = archive.namelist()
    assert sum(name.endswith("frames.ndjson") for name in names) == 2, names
    report = outcome(page).get_by_role("link", name="Report").get_attribute("href")
    assert report is not None
    assert "Two (b) controllers" in page.request.get(report).text()

    (folder,) = lab.results.glob("Two*controllers*")
    for run in lab.runs(folder.name).values():
        assert run["status"] == "complete"
        configuration = run["configuration"]
        assert (configuration["network"]["trace"], configuration["network"]["rtt_ms"]) == ("stairs", 80)
        assert (configuration["movement"], configuration["width"], configuration["height"]) == ("walk.csv", 1000, 640)
    assert (next(folder.glob("runs/*latency*")) / "link.ndjson").read_text().count("\n") > 2, "the link was not watched"
    begun = ("/start", {"trace": "stairs", "loop": True, "delay_ms": 40})
    seeks = [("/seek", {"position_ms": 1000 * s}) for s in (17, 27, 0)]  # 13 s and 3 s before the movement, and with it
    assert lab.shaper.asked == [begun, *seeks, ("/stop", {})] * 2

    page.get_by_role("link", name="Experiments").click()
    row = page.get_by_role("row", name="Two (b) controllers")
    expect(row.get_by_role("cell").first).to_have_text("2")
    expect(row.get_by_role("link", name="Report")).to_have_attribute("href", report)
    page.goto(lab.url + SCENE)
    expect(page.get_by_label("Adaptation"), "the person's settings are back").to_have_value("l2a")


def test_a_file_of_this_visit_and_what_makes_no_sense(open_page: OpenPage, lab: PageLab, tmp_path: Path) -> None:
    (tmp_path / "my walk.csv").write_text(WALK)
    (tmp_path / "broken.csv").write_text("t_ms,x\n1,2\n")
    page = open_page(SCENE, url=lab.url, expected_errors="400")
    wait_for_frames(page)
    page.get_by_role("complementary", name="Lab").get_by_role("button", name="Experiment").click()
    movement = dialog(page).get_by_label("Movement file for the experiment")
    movement.set_input_files(tmp_path / "broken.csv")
    expect(dialog(page).get_by_role("alert")).to_contain_text("broken.csv")
    movement.set_input_files(tmp_path / "my walk.csv")
    expect(dialog(page).get_by_role("combobox", name="Movement")).to_have_value("file/my walk.csv")
    expect(dialog(page).get_by_role("button", name="Start"), "it has to be looked for").to_be_in_viewport(ratio=1)
    repeats = dialog(page).get_by_role("textbox", name="Repeats")
    repeats.fill("two")
    start(page)
    expect(dialog(page).get_by_role("alert")).to_contain_text("repeats: input should be a valid integer")
    expect(repeats, "what was typed is lost").to_have_value("two")
    repeats.fill("1")
    dialog(page).get_by_role("textbox", name="Run duration").fill("3")
    start(page)
    expect(dialog(page).get_by_role("alert")).to_contain_text("lasts 2.0 s, less than a run's 3 s")
    assert list(lab.results.glob("Pebbles-*")) == []


FILE = """name = "Twin"
scenes = ["pebbles"]
movements = ["stroll"]
networks = ["20mbit,20ms-rtt"]
controllers = [3]
duration_s = 1.5
warm_up_s = 0.5
viewport = "320x180"
capture_every_s = 0.5
sample_stride = 5
"""


@pytest.mark.slow
@pytest.mark.timeout(300)  # two experiments, and the store's first check
def test_page_and_command_write_identical_folders(open_page: OpenPage, lab: PageLab, tmp_path: Path) -> None:
    file, out = tmp_path / "twin.toml", tmp_path / "out"
    file.write_text(FILE)
    status, _, errors = finished(started("experiment", "run", str(file), "--url", lab.url, "--out", str(out)))
    assert status == 0, errors
    page = open_page(SCENE, url=lab.url)
    wait_for_frames(page)
    page.get_by_role("complementary", name="Lab").get_by_role("button", name="Experiment").click()
    dialog(page).get_by_text("Edit as a file").click()
    dialog(page).get_by_label("Experiment file").fill(FILE)
    start(page)
    expect(outcome(page)).to_contain_text("All runs are complete.", timeout=STORED_MS)
    expect(outcome(page).get_by_role("link", name="Samples")).to_be_visible()
    (performed,) = lab.results.glob("Twin-*")
    (command,), (uploaded,) = out.glob("runs/*"), performed.glob("runs/*")
    assert command.name == uploaded.name
    assert files(command) == files(uploaded)
    ours, theirs = (StoredRun(folder).record for folder in (command, uploaded))
    assert theirs.configuration == ours.configuration
    assert theirs.model_dump().keys() == ours.model_dump().keys()
    for name in ("points_sha256", "inputs_sha256", "server", "scene_bytes", "scene_sha256", "backend", "machine"):
        assert getattr(theirs, name) == getattr(ours, name) is not None, name
    for name in ("browser", "load", "recording"):
        assert getattr(theirs, name) is not None, name
    for load in (ours.load, theirs.load):
        assert load is not None
        assert load.render_busy_share is not None
    summaries = [summarise(folder).figures for folder in (command, uploaded)]
    assert known(summaries[0]) == known(summaries[1]), "a figure is missing on one side"
    plans = [json.loads((folder / "experiment.json").read_text()) for folder in (out, performed)]
    assert plans[0]["plan"] == plans[1]["plan"]
    assert plans[0].keys() == plans[1].keys()


def files(run: Path) -> set[str]:
    """Without the numbers of requests and captures, which differ by chance."""
    names = {str(path.relative_to(run)) for path in run.rglob("*")}
    return {name if "/" not in name else f"{Path(name).parent}/*{''.join(Path(name).suffixes)}" for name in names}


def known(figures: Any) -> set[str]:
    """Names of figures that are there."""

    def walk(value: Any, path: str) -> Iterator[str]:
        if isinstance(value, dict):
            for key, inside in value.items():
                yield from walk(inside, f"{path}.{key}" if path != ".rungs" else path)
        elif value is not None:
            yield path

    return set(walk(figures.model_dump(), ""))
