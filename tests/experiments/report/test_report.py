"""The report of a made-up comparison: its contents, and that it is self-contained."""

from __future__ import annotations

import html.parser
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tests.experiments.report.test_cli import rows
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report.page import MOST_RUNS
from tigas_experiments.report.report import write_report
from tigas_experiments.wire.run import Network

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
    """The visible text, without styles and drawings."""
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
        "compare-1",
        "Slow & Steady",
        "dash.js 5.0; 30 frames/s, segments of 1 s, chunks of 1, target 120 ms; 640×360 at 1414 kbit/s (avc1.42c01e)",
    ):
        assert expected in text
    assert "processors were saturated during 100% of the run" in text
    assert page.count("<svg") == 2 + 2 * 7, "overview and quality, and of each network all but the one over round trips"
    assert page.count('src="data:image/jpeg;base64,') == 8
    assert page.count('scope="colgroup"') == 14
    assert "4g-<bus>" not in page, "names are escaped"
    for outside in ("http://", "https://", 'src="h', "@import", "url("):
        assert outside not in page.replace("http://www.w3.org/", "").replace("http://purl.org/", "").replace(
            "http://creativecommons.org/", ""
        ).replace("url(#", ""), f"{outside} is fetched"
    assert [row["motion_to_photon_p50_ms"] for row in rows(folder / "runs.csv")] == ["40.0", "140.0", "60.0", "400.0"]
    assert (folder / "headline.png").read_bytes().startswith(b"\x89PNG")


def test_equal_runs_give_equal_reports(folder: Path, tmp_path: Path) -> None:
    outs = [tmp_path / "a", tmp_path / "b"]
    for out in outs:
        out.mkdir()
        write_report(folder, out)
    names = [path.name for path in outs[0].iterdir() if path.suffix != ".png"]
    assert {"report.html", "headline.svg", "table.md", "runs.csv"} <= set(names)
    for name in names:
        first, second = ((out / name).read_bytes() for out in outs)
        assert first == second, name


def test_a_run_without_result_is_named_and_the_others_stay(folder: Path) -> None:
    (folder / "runs" / "2" / "frames.ndjson").unlink()
    (folder / "runs" / "3" / "run.json").write_text("{")
    report = write_report(folder, folder)
    unfinished, unreadable, *_ = report.warnings
    assert unfinished.startswith("2: no result. runs/2/frames.ndjson cannot be read: ")
    assert unreadable.startswith("3: no result. ")
    assert "run.json is broken" in unreadable
    assert "3: no result." in text_of(report.page.read_text())
    assert "no result" in (folder / "table.md").read_text()


def test_a_report_of_nothing_but_failures(folder: Path) -> None:
    for run in (folder / "runs").iterdir():
        (run / "inputs.ndjson").unlink()
    assert "no result" in text_of(write_report(folder, folder).page.read_text())


def test_a_comparison_over_no_shaped_link(tmp_path: Path) -> None:
    run = write_run(experiment(tmp_path) / "runs" / "1", network=Network())
    (run / "link.ndjson").write_text("")
    page = write_report(tmp_path, tmp_path).page.read_text()
    assert page.count("<svg") == 1 + 7
    assert "Full link rate" not in page


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
    assert (page.count("data:image/jpeg"), page.count("<svg")) == (6, 16)


def test_too_many_runs_over_a_network_are_shown_together_alone(folder: Path) -> None:
    for repeat in range(MOST_RUNS):
        write_run(folder / "runs" / f"more-{repeat}", "stateless", repeat=repeat + 1)
    page = write_report(folder, folder).page.read_text()
    assert "4g-&lt;bus&gt;, run by run" in page
    assert "20mbit,20ms-rtt, run by run" not in page
    assert page.count('src="data:image/jpeg;base64,') == 4
    assert (folder / "table.md").read_text().count("| 20mbit,20ms-rtt |") == 2 + MOST_RUNS
