"""When a run's machine was too busy."""

from __future__ import annotations

import pytest

from tigas_experiments.records.load import Load, LoadSample


@pytest.mark.parametrize(
    ("busy", "saturated"), [(([0.5] * 10), False), ([0.5] * 9 + [1.0], False), ([0.5] * 8 + [1.0] * 2, True)]
)
def test_saturation(busy: list[float], saturated: bool) -> None:
    load = Load.of([LoadSample(unix_ms=0, cpu=cpu, load_average=1) for cpu in busy])
    assert load is not None
    assert load.saturated is saturated


def test_no_samples() -> None:
    assert Load.of([]) is None
