"""Colours and validity of all plots."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from tests.experiments.report.synthetic_results import write_run
from tigas_experiments.report.figures import latencies
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.plot import style
from tigas_experiments.report.results import load


def test_a_plot_takes_the_page_s_colours_and_is_well_formed(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", network="a & <b>")
    with style():
        plot = latencies(Groups.of(load(tmp_path).runs), "a & <b>")
    assert plot is not None
    ElementTree.fromstring(plot.svg)
    assert "var(" not in plot.svg, "a file of its own has colours of its own"
    assert "fill: var(--ink)" in plot.markup
    assert "#1c2430" not in plot.markup
