"""Time series as they are drawn."""

from __future__ import annotations

import numpy as np

from tigas_experiments.report.time_series import BINS, binned, downloaded


def test_a_download_takes_what_the_link_carries() -> None:
    link = np.array([[0.5, 8.0, 0.0], [1.0, 16.0, 0.0], [1.5, 0.0, 0.0]])
    assert downloaded(link).tolist() == [0.5, 1.5, 1.5]


def test_long_series_are_drawn_by_their_medians() -> None:
    times = np.arange(10_000) / 100
    values = np.where(np.arange(10_000) % 10 == 0, 900.0, 40.0)
    binned_times, medians = binned(times, values)
    assert len(binned_times) <= BINS + 1
    assert set(medians.tolist()) == {40.0}
    assert binned(times[:5], values[:5])[1].tolist() == [900, 40, 40, 40, 40]
