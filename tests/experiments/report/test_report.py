"""`tigas report`: the files it writes, its output, and its errors for invalid input."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import pytest

from tests.command import Result, tigas
from tests.experiments import made_up
from tests.experiments.report.synthetic_results import change, rows, text_of, write_large, write_run
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.report import figures, report
from tigas_experiments.report.cli import MAX_COLUMNS, MOST_NETWORKS
from tigas_experiments.report.report import MOST_RUNS, write_report
from tigas_experiments.report.run_table import load_results
from tigas_experiments.wire.run import Network

COMMAND = "tigas experiment run '4g-<bus>.toml'"
OWN_ADDRESSES = ("http://www.w3.org/", "http://purl.org/", "http://creativecommons.org/", "url(#")
"""Addresses in a page that a browser does not fetch."""


def run_report(folder: Path, *options: str) -> Result:
    """The command as a person types it."""
    return tigas("report", folder, *options)


def record(name: str = "compare-1", **fields: object) -> ExperimentRecord:
    fixed = {"created": "2026-01-01T00:00:00Z", "source": "command", "plan": {}}
    return ExperimentRecord.model_validate({"name": name, **fixed, **fields})


def page_text(folder: Path) -> str:
    return text_of((folder / "report.html").read_text())


@pytest.fixture
def comparison(tmp_path: Path) -> Path:
    """Two modes over two networks, with snapshots."""
    write_experiment(tmp_path, record(command=COMMAND))
    bus = Network(trace="4g-<bus>")
    made_up.write_run(tmp_path / "runs" / "1", "stateless", 40)
    made_up.write_run(tmp_path / "runs" / "2", "dash-tuned", 140, busy=1.0)
    made_up.write_run(tmp_path / "runs" / "3", "stateless", 60, network=bus)
    made_up.write_run(tmp_path / "runs" / "4", "dash-tuned", 400, network=bus)
    return tmp_path


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Two controllers, two round trips, two repeats."""
    for name, delay in (("latency", 130.0), ("seen", 40.0)):
        for rtt in (20.0, 300.0):
            for repeat in (0, 1):
                run = tmp_path / "runs" / f"{name}-{rtt:g}-{repeat}"
                write_run(run, name, "bus", rtt, delay_ms=delay + rtt, repeat=repeat)
    return tmp_path


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out figures, which take most of the time."""
    monkeypatch.setattr(report, "_write_figures", lambda *_: {None: [], "bus": [], "20mbit": [], "4g-<bus>": []})


@pytest.mark.slow
def test_the_page_says_what_was_measured_and_stands_alone(comparison: Path) -> None:
    page = write_report(comparison, comparison).page.read_text()
    text = text_of(page)
    for expected in (
        "Stateless, seen",
        "DASH, tuned",
        "4g-<bus>",
        COMMAND,
        "compare-1",
        "Slow & Steady",
        "dash.js 5.0; 30 frames/s, segments of 1 s, chunks of 1, target 120 ms; 640×360 at 1414 kbit/s (avc1.42c01e)",
        "processors or the render service were saturated during 100% of the run",
        "DASH tuned*",
    ):
        assert expected in text
    assert page.count("<svg") == 2 + 2 * 7, "overview and quality, and of each network all but the one over round trips"
    assert page.count('src="data:image/webp;base64,') == 8
    assert page.count('scope="colgroup"') == 14
    assert "4g-<bus>" not in page, "names are escaped"
    links = dict(re.findall(r'download="([^"]+)" href="data:text/csv;base64,([^"]+)"', page))
    assert {name: base64.b64decode(data) for name, data in links.items()} == {
        name: (comparison / name).read_bytes() for name in ("runs.csv", "groups.csv", "differences.csv")
    }
    assert page.count("href=") == len(links) + page.count("xlink:href="), "nothing leads away from the page"
    for address in OWN_ADDRESSES:
        page = page.replace(address, "")
    for outside in ("http://", "https://", 'src="h', "<script", "<link", "@import", "url("):
        assert outside not in page, f"{outside} is fetched"
    assert (comparison / "headline.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("no_figures")
def test_the_terminal_has_room_for_few_networks_of_few_runs(tmp_path: Path) -> None:
    for network in range(MOST_NETWORKS + 1):
        write_run(tmp_path / "runs" / f"{network}", network=f"net{network}", seconds=1.0)
    for repeat in range(MAX_COLUMNS):
        write_run(tmp_path / "runs" / f"0-{repeat}", network="net0", seconds=1.0, repeat=repeat + 1)
    output = run_report(tmp_path).output
    assert f"net0,20ms-rtt: {MAX_COLUMNS + 1} runs, a row each in table.md." in output
    assert output.count("Motion-to-photon") == MOST_NETWORKS - 1
    assert "\n1 more in table.md." in output


@pytest.mark.usefixtures("no_figures")
def test_anyone_may_be_the_baseline(experiment: Path) -> None:
    for asked, baseline, other in (([], "latency", "seen"), (["--baseline", "seen"], "seen", "latency")):
        assert run_report(experiment, *asked).exit_code == 0
        found = {(row["baseline"], row["controller"]) for row in rows(experiment / "differences.csv")}
        assert found == {(baseline, other)}
        assert f"Against {baseline.title()}" in page_text(experiment)


@pytest.mark.usefixtures("no_figures")
def test_runs_without_result_are_listed_with_reasons_and_in_no_figure(experiment: Path) -> None:
    runs = experiment / "runs"
    (runs / "seen-20-0" / "run.json").write_text('{"status": "comp')
    (runs / "seen-300-0" / "frames.ndjson").unlink()
    change(runs / "seen-300-1", mood="good")  # a field of a newer version
    change(runs / "latency-20-0", status="running")
    inputs = runs / "latency-300-0" / "inputs.ndjson"
    inputs.write_text(inputs.read_text()[:-20])
    nan = runs / "latency-300-1" / "frames.ndjson"
    nan.write_text(nan.read_text().replace('"at":', '"at":NaN,"was":', 1))
    said = run_report(experiment)
    assert said.exit_code == 0, said.output
    assert "6 of 8 runs failed" in said.output
    text = page_text(experiment)
    for reason in (
        "run.json is broken",
        "frames.ndjson cannot be read: No such file or directory.",
        "mood",
        "The run is incomplete: it did not finish.",
        "inputs.ndjson, line 100",
        "frames.ndjson, line 1",
    ):
        assert reason in text
    by_folder = {row["folder"]: row for row in rows(experiment / "runs.csv")}
    assert [row["status"] for row in by_folder.values()].count("complete") == 2
    assert by_folder["latency-20-0"]["status"] == "running"
    assert by_folder["seen-20-0"]["status"] == "broken"
    assert "did not finish" in by_folder["latency-20-0"]["problem"]
    assert sum(int(row["runs"]) for row in rows(experiment / "groups.csv")) == 2
    assert "no result: runs/seen-300-0/frames.ndjson" in (experiment / "table.md").read_text()


def test_nothing_but_failures_is_a_report_too(experiment: Path) -> None:
    for run in (experiment / "runs").iterdir():
        (run / "inputs.ndjson").unlink()
    said = run_report(experiment)
    assert said.exit_code == 0, said.output
    assert "8 of 8 runs failed" in page_text(experiment)
    assert rows(experiment / "groups.csv") == []


@pytest.mark.slow
def test_what_never_came_and_nothing_at_all_are_reports_too(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", delay_ms=40)
    frames = (path / "frames.ndjson").read_text().splitlines(keepends=True)
    (path / "frames.ndjson").write_text("".join(frames[:60]))
    empty = write_run(tmp_path / "runs" / "b", network="empty")
    for name in ("inputs", "frames", "traffic", "link", "quality"):
        (empty / f"{name}.ndjson").write_text("")
    page = write_report(tmp_path, tmp_path).page.read_text()
    assert "<td>never</td>" in page
    assert "<td>–</td>" in page


@pytest.mark.extended
def test_names_are_text_and_nothing_else(tmp_path: Path) -> None:
    evil = "<script>alert('$x$')</script>"
    names = (evil, "../../etc/passwd", "$\\frac{$", "测试\u0001", "=1+1,\n")
    write_experiment(tmp_path, record(evil))
    for repeat, name in enumerate(names):
        write_run(tmp_path / "runs" / f"{repeat}", name, name, movement=f"{evil}.csv", scene=evil, seconds=1.0)
    said = run_report(tmp_path)
    assert said.exit_code == 0, said.output
    page = (tmp_path / "report.html").read_text()
    assert "<script" not in page
    assert "<h1>&lt;script&gt;" in page
    assert evil in page_text(tmp_path)
    assert {row["network"].removeprefix("'") for row in rows(tmp_path / "runs.csv")} == set(names)
    written = {path.name for path in tmp_path.iterdir() if path.name != "experiment.json"}
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in written)
    (tmp_path / "experiment.json").write_text("{")
    assert load_results(tmp_path).title == tmp_path.name


@pytest.mark.usefixtures("no_figures")
def test_a_thread_at_its_limit_is_in_the_table_of_runs(tmp_path: Path) -> None:
    for repeat, pegged in enumerate((None, {}, {"chromium renderer": 0.34, "tigas render": 0.2})):
        change(write_run(tmp_path / "runs" / f"{repeat}", repeat=repeat), load={"pegged": pegged})
    page = write_report(tmp_path, tmp_path).page.read_text()
    for expected in ("<td>unknown</td>", "<td>never</td>", "<td>34 % (chromium renderer)</td>"):
        assert page.count(expected) == 1, expected


@pytest.mark.usefixtures("no_figures")
def test_all_networks_have_a_table_if_there_are_several(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "one", "l2a|\n", "bus", delay_ms=40)
    write_report(tmp_path, tmp_path)
    assert "All networks" not in (tmp_path / "report.html").read_text()
    assert "| 20 | l2a\\| | 1 | 40 |" in (tmp_path / "overall.md").read_text()
    write_run(tmp_path / "runs" / "other", "l2a|\n", "tram", delay_ms=80)
    write_report(tmp_path, tmp_path)
    assert "Means over the 2 networks" in (tmp_path / "report.html").read_text()


@pytest.mark.extended
def test_a_large_experiment_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "MOST_NETWORKS", 1)
    monkeypatch.setattr(report, "MOST_NETWORKS", 1)
    count = write_large(tmp_path, ("first", "second"), (20, 50), 1, seconds=20.0)
    assert count == 24
    heard: list[tuple[str, int, int | None]] = []
    made = write_report(tmp_path, tmp_path, on_progress=lambda *step: heard.append(step))
    assert heard == [
        *(("reads runs", done, 24) for done in range(1, 25)),
        *(("draws figures", done, None) for done in range(1, 2 + 8 + 1)),
    ], "one network is drawn by itself"
    assert "Only the first 1 of 2 networks" in made.page.read_text()
    assert made.page.stat().st_size < 1_200_000, "however long the runs are"
    assert len(rows(tmp_path / "groups.csv")) == 24


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("broken", ["snapshot.json", "captures/view.png", "captures/0000.png"])
def test_a_snapshot_that_is_broken_costs_itself_alone(comparison: Path, broken: str) -> None:
    (comparison / "runs" / "1" / broken).write_bytes(b"rubbish")
    made = write_report(comparison, comparison)
    assert len(made.results.runs) == 4
    assert made.page.read_text().count("data:image/webp") == 6


@pytest.mark.usefixtures("no_figures")
def test_too_many_runs_over_a_network_are_shown_together_alone(comparison: Path) -> None:
    for repeat in range(MOST_RUNS):
        made_up.write_run(comparison / "runs" / f"more-{repeat}", "stateless", repeat=repeat + 1)
    page = write_report(comparison, comparison).page.read_text()
    assert "4g-&lt;bus&gt;, run by run" in page
    assert "20mbit,20ms-rtt, run by run" not in page
    assert page.count('src="data:image/webp;base64,') == 4
    assert (comparison / "table.md").read_text().count("| 20mbit,20ms-rtt |") == 2 + MOST_RUNS


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


@pytest.mark.parametrize(
    ("method", "error", "sentence"),
    [
        ("iterdir", PermissionError(13, "Permission denied"), "cannot be read (Permission denied)"),
        ("write_text", OSError(28, "No space left on device"), "No space left on device"),
    ],
)
def test_a_folder_that_cannot_be_used_is_one_sentence(
    experiment: Path, monkeypatch: pytest.MonkeyPatch, method: str, error: OSError, sentence: str
) -> None:
    def refused(*_: object, **__: object) -> None:  # root, possibly the tests' user, has all permissions
        raise error

    monkeypatch.setattr(Path, method, refused)
    said = run_report(experiment)
    assert said.exit_code == 1
    assert sentence in said.output
