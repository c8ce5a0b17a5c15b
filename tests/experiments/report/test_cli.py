"""`tigas report`: its output, and its errors for invalid input."""

from __future__ import annotations

import base64
import csv
import html.parser
import re
from pathlib import Path

import pytest

from tests.command import Result, tigas
from tests.experiments.report.synthetic_results import write_run
from tigas_experiments.report.cli import MAX_COLUMNS, MOST_NETWORKS


def run_report(folder: Path, *options: str) -> Result:
    """The command as a person types it."""
    return tigas("report", folder, *options)


def page_text(folder: Path) -> str:
    """The visible text of report.html, without styles and drawings."""
    parts: list[str] = []

    class Reader(html.parser.HTMLParser):
        def handle_data(self, data: str) -> None:
            parts.append(data)

    Reader().feed((folder / "report.html").read_text())
    return " ".join(" ".join(parts).split())


def rows(path: Path) -> list[dict[str, str]]:
    """Of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Two controllers, two round trips, two repeats."""
    for name, delay in (("latency", 130.0), ("budget", 40.0)):
        for rtt in (20.0, 300.0):
            for repeat in (0, 1):
                write_run(
                    tmp_path / "runs" / f"{name}-{rtt:g}-{repeat}",
                    name,
                    "bus",
                    rtt,
                    delay_ms=delay + rtt,
                    repeat=repeat,
                )
    return tmp_path


def test_a_report_stands_alone(experiment: Path) -> None:
    said = run_report(experiment)
    assert said.exit_code == 0, said.output
    assert "bus,300ms-rtt" in said.output
    assert "within 108 ms" in said.output, "the table of each network"
    page = (experiment / "report.html").read_text()
    known = ("http://www.w3.org/", "http://purl.org/", "http://creativecommons.org/", "url(#")
    for name in known:
        page = page.replace(name, "")
    for outside in ("http://", "https://", "<script", "<link", "@import", "url("):
        assert outside not in page, f"{outside} is fetched"
    links = dict(re.findall(r'download="([^"]+)" href="data:text/csv;base64,([^"]+)"', page))
    assert {name: base64.b64decode(data) for name, data in links.items()} == {
        name: (experiment / name).read_bytes() for name in ("runs.csv", "groups.csv", "differences.csv")
    }
    assert page.count("href=") == len(links) + page.count("xlink:href="), "nothing leads away from the page"


def test_the_terminal_has_room_for_few_networks_of_few_runs(tmp_path: Path) -> None:
    for network in range(MOST_NETWORKS + 1):
        write_run(tmp_path / "runs" / f"{network}", network=f"net{network}", seconds=1.0)
    for repeat in range(MAX_COLUMNS):
        write_run(tmp_path / "runs" / f"0-{repeat}", network="net0", seconds=1.0, repeat=repeat + 1)
    output = run_report(tmp_path).output
    assert f"net0,20ms-rtt: {MAX_COLUMNS + 1} runs, a row each in table.md." in output
    assert output.count("Motion-to-photon") == MOST_NETWORKS - 1
    assert "\n1 more in table.md." in output


def test_equal_runs_give_equal_reports(experiment: Path) -> None:
    run_report(experiment)
    names = sorted(path.name for path in experiment.iterdir() if path.is_file())
    first = [(experiment / name).read_bytes() for name in names]
    run_report(experiment)
    assert [(experiment / name).read_bytes() for name in names] == first
    assert {"report.html", "runs.csv", "groups.csv", "differences.csv", "overview.svg", "01-bus_rtt.svg"} <= set(names)


def test_anyone_may_be_the_baseline(experiment: Path) -> None:
    for asked, baseline, other in (([], "latency", "budget"), (["--baseline", "budget"], "budget", "latency")):
        assert run_report(experiment, *asked).exit_code == 0
        found = {(row["baseline"], row["controller"]) for row in rows(experiment / "differences.csv")}
        assert found == {(baseline, other)}
        assert f"Against {baseline.title()}" in page_text(experiment)
    said = run_report(experiment, "--baseline", "bola")
    assert said.exit_code == 1
    assert "There are no runs of the controller 'bola', only of latency, budget." in said.output


def test_runs_without_result_are_listed_with_reasons_and_in_no_figure(experiment: Path) -> None:
    runs = experiment / "runs"
    (runs / "budget-20-0" / "run.json").write_text('{"status": "comp')
    (runs / "budget-300-0" / "frames.ndjson").unlink()
    path = runs / "latency-20-0" / "run.json"
    path.write_text(path.read_text().replace('"complete"', '"running"', 1))
    inputs = runs / "latency-300-0" / "inputs.ndjson"
    inputs.write_text(inputs.read_text()[:-20])
    nan = runs / "latency-300-1" / "frames.ndjson"
    nan.write_text(nan.read_text().replace('"at":', '"at":NaN,"was":', 1))
    said = run_report(experiment)
    assert said.exit_code == 0, said.output
    assert "5 of 8 runs failed" in said.output
    text = page_text(experiment)
    for reason in (
        "run.json is broken",
        "frames.ndjson cannot be read: No such file or directory.",
        "The run is incomplete: it was never ended.",
        "inputs.ndjson, line 100",
        "frames.ndjson, line 1",
    ):
        assert reason in text
    by_folder = {row["folder"]: row for row in rows(experiment / "runs.csv")}
    assert [row["status"] for row in by_folder.values()].count("complete") == 3
    assert by_folder["latency-20-0"]["status"] == "running"
    assert by_folder["budget-20-0"]["status"] == "broken"
    assert "never ended" in by_folder["latency-20-0"]["problem"]
    assert sum(int(row["runs"]) for row in rows(experiment / "groups.csv")) == 3


def test_a_field_of_a_newer_version_costs_its_run_alone(experiment: Path) -> None:
    path = experiment / "runs" / "budget-20-0" / "run.json"
    path.write_text(path.read_text().replace("{", '{"mood": "good",', 1))
    assert run_report(experiment).exit_code == 0
    assert "mood" in page_text(experiment)
    assert len(rows(experiment / "runs.csv")) == 8


def test_nothing_but_failures_is_a_report_too(experiment: Path) -> None:
    for run in (experiment / "runs").iterdir():
        (run / "inputs.ndjson").unlink()
    said = run_report(experiment)
    assert said.exit_code == 0, said.output
    assert "8 of 8 runs failed" in page_text(experiment)
    assert rows(experiment / "groups.csv") == []


def test_names_are_text_and_nothing_else(tmp_path: Path) -> None:
    evil = "<script>alert('$x$')</script>"
    names = (evil, "../../etc/passwd", "$\\frac{$", "测试\u0001", "=1+1,\n")
    for repeat, name in enumerate(names):
        write_run(tmp_path / "runs" / f"{repeat}", name, name, movement=f"{evil}.csv", scene=evil)
    said = run_report(tmp_path)
    assert said.exit_code == 0, said.output
    page = (tmp_path / "report.html").read_text()
    assert "<script" not in page
    assert evil in page_text(tmp_path)
    assert {row["network"].removeprefix("'") for row in rows(tmp_path / "runs.csv")} == set(names)
    written = {path.name for path in tmp_path.iterdir()}
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in written)


@pytest.mark.parametrize("made", ["nothing", "empty", "runs", "file", "hidden"])
def test_without_runs_there_is_one_sentence(tmp_path: Path, made: str) -> None:
    folder = tmp_path / "it"
    if made != "nothing":
        folder.mkdir()
    if made == "runs":
        (folder / "runs").mkdir()
    if made == "file":
        (folder / "runs").write_text("")
    if made == "hidden":
        (folder / "runs" / ".upload").mkdir(parents=True)
    said = run_report(folder)
    assert said.exit_code == 1
    assert "has no runs yet." in said.output or "a report needs an experiment's folder." in said.output
    assert "Traceback" not in said.output
    assert not (folder / "report.html").exists()


def test_without_permission_there_is_one_sentence(experiment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_: Path) -> None:  # root, possibly the tests' user, has all permissions
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refused)
    said = run_report(experiment)
    assert said.exit_code == 1
    assert "cannot be read (Permission denied)" in said.output


def test_a_full_disk_is_one_sentence(experiment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    said = run_report(experiment)
    assert said.exit_code == 1
    assert "No space left on device" in said.output
