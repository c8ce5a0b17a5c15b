"""The report of runs that nobody made: what it shows, that it stands alone, and that equal runs give equal reports."""

from __future__ import annotations

import html.parser
import json
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tigas_common.wire.run import Network
from tigas_experiments.records.summary import summarise
from tigas_experiments.report.page import warnings, write_report
from tigas_experiments.report.table import markdown


@pytest.fixture
def runs(tmp_path: Path) -> list[Path]:
    """Two modes over two networks."""
    bus = Network(trace="4g-<bus>")
    return [
        write_run(tmp_path / "1", "stateless", 40),
        write_run(tmp_path / "2", "dash-tuned", 140, busy=1.0),
        write_run(tmp_path / "3", "stateless", 60, network=bus),
        write_run(tmp_path / "4", "dash-tuned", 400, network=bus),
    ]


def text_of(page: str) -> str:
    """What a reader sees, without styles and drawings."""
    parts: list[str] = []

    class Reader(html.parser.HTMLParser):
        def handle_data(self, data: str) -> None:
            parts.append(data)

    Reader().feed(page)
    return " ".join(" ".join(parts).split())


def test_the_report_says_what_was_measured(runs: list[Path], tmp_path: Path) -> None:
    write_report(runs, tmp_path, "A walk", "tigas compare --network '4g-<bus>'")
    page = (tmp_path / "report.html").read_text()
    text = text_of(page)
    for expected in (
        "Stateless, budget",
        "DASH, tuned",
        "4g-<bus>",
        "tigas compare --network '4g-<bus>'",
        "Slow & Steady",
        "dash.js 5.0; 30 frames/s, segments of 1 s, chunks of 1, target 120 ms; 640×360 at 1414 kbit/s (avc1.42c01e)",
    ):
        assert expected in text
    assert "processors were saturated during 100% of the run" in text
    assert page.count("<svg") == 8
    assert page.count('src="data:image/jpeg;base64,') == 8
    assert page.count('scope="colgroup"') == 10
    assert "4g-<bus>" not in page, "names are escaped"
    for outside in ("http://", "https://", 'src="h', "@import", "url("):
        assert outside not in page.replace("http://www.w3.org/", "").replace("http://purl.org/", "").replace(
            "http://creativecommons.org/", ""
        ).replace("url(#", ""), f"{outside} is fetched"
    data = json.loads((tmp_path / "report.json").read_text())
    assert [run["figures"]["latencies"]["p50"] for run in data["runs"]] == [40, 140, 60, 400]
    assert (tmp_path / "headline.png").read_bytes().startswith(b"\x89PNG")


def test_equal_runs_give_equal_reports(runs: list[Path], tmp_path: Path) -> None:
    outs = [tmp_path / "a", tmp_path / "b"]
    for out in outs:
        out.mkdir()
        write_report(runs, out, "A walk", "tigas compare")
    for name in ("report.html", "headline.svg", "table.md", "report.json"):
        first, second = ((out / name).read_bytes() for out in outs)
        assert first == second, name


def test_a_run_without_result_is_named_and_the_others_stay(runs: list[Path], tmp_path: Path) -> None:
    (runs[1] / "frames.ndjson").unlink()
    (runs[2] / "run.json").write_text("{")
    data = write_report(runs, tmp_path, "A walk", "tigas compare")
    assert [run.figures is None for run in data.runs] == [False, True, False]
    unreadable, unfinished, *_ = warnings(data)
    assert unreadable.startswith("3: there is no result. ")
    assert "run.json is broken" in unreadable
    assert "DASH, tuned: there is no result." in unfinished
    assert "3: there is no result." in text_of((tmp_path / "report.html").read_text())
    assert "no result" in (tmp_path / "table.md").read_text()


def test_a_report_of_nothing_but_failures(runs: list[Path], tmp_path: Path) -> None:
    for run in runs:
        (run / "inputs.ndjson").unlink()
    write_report(runs, tmp_path, "A walk", "tigas compare")
    assert "there is no result" in text_of((tmp_path / "report.html").read_text())


def test_round_trips_over_one_trace_are_told_apart(tmp_path: Path) -> None:
    runs = [
        write_run(tmp_path / f"{rtt:g}", "stateless", 40 + rtt, network=Network(trace="4g-bus", rtt_ms=rtt))
        for rtt in (20.0, 100.0)
    ]
    write_report(runs, tmp_path, "A walk", "tigas compare")
    text = text_of((tmp_path / "report.html").read_text())
    assert "4g-bus,20ms-rtt" in text
    assert (tmp_path / "table.md").read_text().count("4g-bus,100ms-rtt") == 1


def test_a_markdown_table_has_a_row_for_each_run(runs: list[Path]) -> None:
    lines = markdown(map(summarise, runs)).splitlines()
    assert len(lines) == 2 + len(runs)
    assert lines[2].startswith("| 20mbit,20ms-rtt | Stateless, budget | 40 | 40 | 40 | 100.0 | ")
    assert len({line.count("|") for line in lines}) == 1


@pytest.mark.parametrize("broken", ["moment.json", "captures/view.png", "captures/0000.png"])
def test_a_moment_that_is_broken_costs_its_drawings_alone(runs: list[Path], tmp_path: Path, broken: str) -> None:
    (runs[0] / broken).write_bytes(b"rubbish")
    data = write_report(runs, tmp_path, "A walk", "tigas compare")
    assert all(run.figures for run in data.runs)
    assert (tmp_path / "report.html").read_text().count("data:image/jpeg") == 6
