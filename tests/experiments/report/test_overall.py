"""The table of an experiment as a whole, against runs whose figures are known."""

from __future__ import annotations

from pathlib import Path

from tests.experiments.report.made_up_results import write_run
from tigas_experiments.report.experiment import write_experiment_report
from tigas_experiments.report.metrics import RESPONSE_MEAN
from tigas_experiments.report.overall import markdown, overall
from tigas_experiments.report.results import load


def write_runs(folder: Path, *delays: tuple[str, str, float, float]) -> None:
    """Runs by controller, network, round trip and delay, all in milliseconds."""
    for number, (controller, network, rtt, delay) in enumerate(delays):
        write_run(folder / "runs" / f"{number:02}", controller, network, rtt, delay_ms=delay)


def test_each_network_counts_the_same(tmp_path: Path) -> None:
    write_runs(
        tmp_path,
        ("budget", "bus", 20, 40),
        ("budget", "bus", 20, 60),
        ("budget", "tram", 20, 110),
        ("latency", "bus", 20, 90),
        ("latency", "tram", 20, 90),
    )
    latency, budget = overall(load(tmp_path))
    spread = budget.spread(RESPONSE_MEAN)
    assert spread is not None
    assert (spread.mean, spread.low, spread.high) == (80, 50, 110)
    assert (latency.variant.title, latency.runs, budget.runs) == ("Latency", 2, 3)
    first, _, row, *_ = markdown([budget]).splitlines()
    assert first.startswith("| round trip, ms | controller | runs | Motion-to-photon p50, ms |")
    assert row.startswith("| 20 | Budget | 3 | 80 | 80 | ")


def test_what_not_all_networks_have_is_left_out(tmp_path: Path) -> None:
    write_runs(
        tmp_path,
        ("budget", "bus", 20, 40),
        ("budget", "bus", 300, 40),
        ("latency", "bus", 20, 40),
        ("budget", "tram", 20, 40),
        ("l2a|\n", "tram", 20, 40),
    )
    assert [(row.rtt_ms, row.variant.title) for row in overall(load(tmp_path))] == [(20, "Budget")]


def test_the_page_has_it_where_there_are_several_networks(tmp_path: Path) -> None:
    write_runs(tmp_path, ("l2a|\n", "bus", 20, 40))
    write_experiment_report(tmp_path, tmp_path)
    assert "All networks" not in (tmp_path / "report.html").read_text()
    assert "| 20 | l2a\\| | 1 | 40 |" in (tmp_path / "overall.md").read_text()
    write_run(tmp_path / "runs" / "other", "l2a|\n", "tram", delay_ms=80)
    write_experiment_report(tmp_path, tmp_path)
    assert "Means over the 2 networks" in (tmp_path / "report.html").read_text()
