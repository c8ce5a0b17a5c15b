"""The goal of the attacks, as named by docs/deploy.md."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.hostile.attacks import ATTACKS
from benchmarks.hostile.client import EXPERIMENT, RUN
from benchmarks.hostile.measure import Memory, Polite, Times
from tigas_experiments.run.plan import ExperimentPlan

ALONE = Times.of([10.0] * 100)


def test_every_attack_has_a_name_of_its_own() -> None:
    assert len({attack.name for attack in ATTACKS}) == len(ATTACKS)


def test_attacks_upload_the_run_of_their_experiment(tmp_path: Path) -> None:
    (planned,) = ExperimentPlan.parse(EXPERIMENT["file"], "attack").runs(tmp_path)
    assert planned.slug == RUN


def test_a_frame_that_never_came_took_for_ever() -> None:
    times = Times.of([*(float(n) for n in range(1, 95)), *[None] * 6])
    assert (times.asked, times.lost, times.p50, times.p95) == (100, 6, 50.0, math.inf)
    assert Times.of([*(float(n) for n in range(1, 96)), *[None] * 5]).p95 == 95.0


def test_nothing_measured_is_no_success() -> None:
    assert [*Polite("viewer", Times.of([]), ALONE, ALONE).faults] == ["slow"]
    assert [*Polite("viewer", ALONE, Times.of([]), ALONE).faults] == ["slow"]


@pytest.mark.parametrize(
    ("during", "faults"),
    [([40.0] * 100, []), ([40.1] * 100, ["slow"]), ([10.0] * 99 + [None], ["1 lost"])],
)
def test_the_polite_may_be_a_little_slower_and_lose_nothing(during: list[float | None], faults: list[str]) -> None:
    assert [*Polite("viewer", ALONE, Times.of(during), ALONE).faults] == faults


def test_what_is_lost_afterwards_counts() -> None:
    assert [*Polite("viewer", ALONE, ALONE, Times.of([10.0] * 99 + [None])).faults] == ["1 lost"]


def test_memory_must_come_back() -> None:
    assert [*Memory(before=100, peak=300, after=105).faults] == []
    assert [*Memory(before=100, peak=106, after=106).faults] == ["+6 % memory"]
