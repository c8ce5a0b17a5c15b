"""Controllers against a baseline."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import write_run
from tigas_common.errors import StartError
from tigas_experiments.records.folder import ExperimentRecord
from tigas_experiments.report.differences import against, choose_baseline
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.results import load


def groups(folder: Path, *runs: tuple[str | int, str, str, float]) -> Groups:
    """Of runs by controller, network, movement and delay, ms."""
    for number, (controller, network, movement, delay) in enumerate(runs):
        write_run(folder / "runs" / f"{number:02}", controller, network, movement=movement, delay_ms=delay)
    return Groups.of(load(folder).runs)


def test_only_blocks_that_both_have_are_compared(tmp_path: Path) -> None:
    found = groups(
        tmp_path,
        ("latency", "bus", "a", 40),
        ("latency", "bus", "b", 400),
        ("l2a", "bus", "a", 60),
        ("l2a", "bus", "c", 900),
        ("budget", "tram", "a", 60),
    )
    (one,) = against(found, next(iter(found.looks)))
    estimate = one.estimate(METRICS["frame_age_mean_ms"])
    assert estimate is not None
    assert (one.controller.name, one.blocks, estimate.mean, estimate.blocks) == ("l2a", 1, 20, 1)


def test_all_networks_together_come_first(tmp_path: Path) -> None:
    found = groups(
        tmp_path,
        ("latency", "bus", "a", 40),
        ("latency", "tram", "a", 40),
        ("l2a", "bus", "a", 50),
        ("l2a", "tram", "a", 80),
        ("lol+", "tram", "a", 80),
    )
    compared = against(found, next(iter(found.looks)))
    names = [(each.network, each.controller.name) for each in compared]
    assert names == [(None, "l2a"), ("bus", "l2a"), ("tram", "lol+"), ("tram", "l2a")]
    estimate = compared[0].estimate(METRICS["frame_age_mean_ms"])
    assert estimate is not None
    assert (estimate.mean, estimate.blocks) == (25, 2)


def test_the_baseline_is_the_first_of_the_file_unless_somebody_chooses(tmp_path: Path) -> None:
    found = groups(tmp_path, ("latency", "bus", "a", 40), (2, "bus", "a", 40), ("l2a", "bus", "a", 40))

    def chosen(plan: dict[str, object], asked: str | None = None) -> str:
        record = ExperimentRecord.model_validate({"name": "x", "created": "", "source": "page", "plan": plan})
        controller = choose_baseline(found, record, asked)
        assert controller is not None
        return controller.name

    file: dict[str, object] = {"modes": ["dash-tuned", "stateless"], "controllers": ["budget", 2, "l2a"]}
    assert chosen(file) == "profile-2", "there are no runs of those before it"
    assert chosen(file, "l2a") == "l2a"
    assert chosen({"modes": "odd"}) == "latency"
    with pytest.raises(StartError, match="no runs of the controller 'bola', only of latency, l2a, profile-2"):
        chosen(file, "bola")
    assert choose_baseline(Groups.of([]), None, None) is None
