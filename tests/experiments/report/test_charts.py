"""The charts of a panel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.experiments.report.synthetic_results import write_run
from tigas_experiments.report.charts import BINS, binned, distribution, downloaded, draw_boxes
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.plot import panel_grid
from tigas_experiments.report.results import load


def test_a_box_stands_over_its_controller_where_another_has_no_runs(tmp_path: Path) -> None:
    for number, (name, rtt) in enumerate((("latency", 20.0), ("budget", 20.0), ("budget", 300.0))):
        write_run(tmp_path / "runs" / f"{number}", name, rtt_ms=rtt)
    groups = Groups.of(load(tmp_path).runs)
    _, panels = panel_grid(2, share=True)
    for panel, rtt in zip(panels, (20.0, 300.0), strict=True):
        draw_boxes(panel, groups.at("bus", rtt), groups.looks)
    boxes = [[box.get_path().get_extents() for box in panel.patches] for panel in panels]
    assert [[round((box.x0 + box.x1) / 2, 9) for box in panel] for panel in boxes] == [[0, 1], [1]]
    assert [label.get_text() for label in panels[1].get_xticklabels()] == ["Latency", "Budget"]


def test_distributions_count_what_never_came() -> None:
    values, shares = distribution(np.array([30.0, 10.0, np.inf, 20.0]))
    assert (values.tolist(), shares.tolist()) == ([10, 20, 30], [0.25, 0.5, 0.75])
    values, shares = distribution(np.array([np.inf]))
    assert (values.tolist(), shares.tolist()) == ([], [])
    values, shares = distribution(np.arange(100_000.0))
    assert (len(values), values[0], values[-1], shares[-1]) == (200, 0, 99_999, 1.0)


def test_a_download_takes_what_the_link_carries() -> None:
    link = np.array([[0.5, 8.0], [1.0, 16.0], [1.5, 0.0]])
    assert downloaded(link).tolist() == [0.5, 1.5, 1.5]


def test_long_series_are_drawn_by_their_medians() -> None:
    times = np.arange(10_000) / 100
    values = np.where(np.arange(10_000) % 10 == 0, 900.0, 40.0)
    binned_times, medians = binned(times, values)
    assert len(binned_times) <= BINS + 1
    assert set(medians.tolist()) == {40.0}
    assert binned(times[:5], values[:5])[1].tolist() == [900, 40, 40, 40, 40]
