"""What tells whether two runs were given the same movement."""

from __future__ import annotations

from pathlib import Path

from tests.experiments.made_up import configuration
from tests.experiments.movement.scenes import scene
from tigas_experiments.movement.points import Point, digest
from tigas_experiments.run.inputs import Inputs


def test_runs_of_one_configuration_have_one_digest() -> None:
    first, second = configuration(seed=1), configuration(seed=1, repeat=2, profile=3)
    one, again, repeated, other = (
        digest(Inputs(Path()).points(each, scene())) for each in (first, first, second, configuration(seed=2))
    )
    assert one == again == repeated
    assert one != other
    assert len(one) == 64


def test_only_what_is_seen_counts() -> None:
    def moved(by: float) -> Point:
        return Point(t_ms=0.0, position=[by, 1.0, 2.0], quaternion=[0.0, 0.0, 0.0, 1.0])

    assert digest([moved(0.0)]) == digest([moved(-0.0)]) == digest([moved(1e-15)])
    assert digest([moved(0.0)]) != digest([moved(1e-6)])
