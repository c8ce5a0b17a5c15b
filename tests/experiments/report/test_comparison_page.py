"""The page of a comparison that nobody made: what it shows, and that it stands alone."""

from __future__ import annotations

import html.parser
import json
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tigas_common.wire.run import Network
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report.report import write_report

COMMAND = "tigas compare --network '4g-<bus>'"


def experiment(folder: Path) -> Path:
    """A folder of a comparison, without runs."""
    write_experiment(
        folder,
        ExperimentRecord(
            name="compare-1",
            created="2026-01-01T00:00:00Z",
            source="command",
            plan={},
            template="comparison",
            command=COMMAND,
        ),
    )
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two modes over two networks."""
    bus = Network(trace="4g-<bus>")
    runs = experiment(tmp_path / "compare-1") / "runs"
    write_run(runs / "1", "stateless", 40)
    write_run(runs / "2", "dash-tuned", 140, busy=1.0)
    write_run(runs / "3", "stateless", 60, network=bus)
    write_run(runs / "4", "dash-tuned", 400, network=bus)
    return runs.parent


def text_of(page: str) -> str:
    """What a reader sees, without styles and drawings."""
    parts: list[str] = []

    class Reader(html.parser.HTMLParser):
        def handle_data(self, data: str) -> None:
            parts.append(data)

    Reader().feed(page)
    return " ".join(" ".join(parts).split())


def test_the_report_says_what_was_measured(folder: Path) -> None:
    page = write_report(folder, folder).page.read_text()
    text = text_of(page)
    for expected in (
        "Stateless, budget",
        "DASH, tuned",
        "4g-<bus>",
        COMMAND,
        "courtyard: one JPEG per pose and low-latency DASH",
        "Slow & Steady",
        "dash.js 5.0; 30 frames/s, segments of 1 s, chunks of 1, target 120 ms; 640×360 at 1414 kbit/s (avc1.42c01e)",
    ):
        assert expected in text
    assert "processors were saturated during 100% of the run" in text
    assert page.count("<svg") == 10
    assert page.count('src="data:image/jpeg;base64,') == 8
    assert page.count('scope="colgroup"') == 14
    assert "4g-<bus>" not in page, "names are escaped"
    for outside in ("http://", "https://", 'src="h', "@import", "url("):
        assert outside not in page.replace("http://www.w3.org/", "").replace("http://purl.org/", "").replace(
            "http://creativecommons.org/", ""
        ).replace("url(#", ""), f"{outside} is fetched"
    data = json.loads((folder / "report.json").read_text())
    assert [run["figures"]["latencies"]["p50"] for run in data["runs"]] == [40, 140, 60, 400]
    assert data["command"] == COMMAND
    assert (folder / "headline.png").read_bytes().startswith(b"\x89PNG")


def test_equal_runs_give_equal_reports(folder: Path, tmp_path: Path) -> None:
    outs = [tmp_path / "a", tmp_path / "b"]
    for out in outs:
        out.mkdir()
        write_report(folder, out)
    names = [path.name for path in outs[0].iterdir() if path.suffix != ".png"]
    assert {"report.html", "headline.svg", "table.md", "report.json", "runs.csv"} <= set(names)
    for name in names:
        first, second = ((out / name).read_bytes() for out in outs)
        assert first == second, name


def test_a_run_without_result_is_named_and_the_others_stay(folder: Path) -> None:
    (folder / "runs" / "2" / "frames.ndjson").unlink()
    (folder / "runs" / "3" / "run.json").write_text("{")
    report = write_report(folder, folder)
    data = json.loads((folder / "report.json").read_text())
    assert [run["figures"] is None for run in data["runs"]] == [False, True, False]
    unreadable, unfinished, *_ = report.warnings
    assert unreadable.startswith("3: there is no result. ")
    assert "run.json is broken" in unreadable
    assert data["unreadable"] == [unreadable]
    assert "DASH, tuned: there is no result." in unfinished
    assert "3: there is no result." in text_of(report.page.read_text())
    assert "no result" in (folder / "table.md").read_text()


def test_a_report_of_nothing_but_failures(folder: Path) -> None:
    for run in (folder / "runs").iterdir():
        (run / "inputs.ndjson").unlink()
    assert "there is no result" in text_of(write_report(folder, folder).page.read_text())


def test_a_comparison_over_no_shaped_link(tmp_path: Path) -> None:
    run = write_run(experiment(tmp_path) / "runs" / "1", network=Network())
    (run / "link.ndjson").write_text("")
    page = write_report(tmp_path, tmp_path).page.read_text()
    assert page.count("<svg") == 5
    assert "What the page received, as there was no shaped link." in page


def test_round_trips_over_one_trace_are_told_apart(tmp_path: Path) -> None:
    runs = experiment(tmp_path) / "runs"
    for rtt in (20.0, 100.0):
        write_run(runs / f"{rtt:g}", "stateless", 40 + rtt, network=Network(trace="4g-bus", rtt_ms=rtt))
    assert "4g-bus,20ms-rtt" in text_of(write_report(tmp_path, tmp_path).page.read_text())
    assert (tmp_path / "table.md").read_text().count("4g-bus,100ms-rtt") == 1


@pytest.mark.parametrize("broken", ["snapshot.json", "captures/view.png", "captures/0000.png"])
def test_a_snapshot_that_is_broken_costs_itself_alone(folder: Path, broken: str) -> None:
    (folder / "runs" / "1" / broken).write_bytes(b"rubbish")
    report = write_report(folder, folder)
    assert len(report.results.runs) == 4
    page = report.page.read_text()
    assert (page.count("data:image/jpeg"), page.count("<svg")) == (6, 10)


def test_either_page_tells_of_either_folder(folder: Path) -> None:
    as_experiment = write_report(folder, folder, "experiment")
    assert "<h2>Claims</h2>" in as_experiment.page.read_text()
    (folder / "experiment.json").unlink()
    assert write_report(folder, folder).template == "experiment", "as folders without a record are"
    assert "one JPEG per pose and low-latency DASH" in write_report(folder, folder, "comparison").page.read_text()
