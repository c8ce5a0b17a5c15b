"""The figures of a report, and their data."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.experiments.report.synthetic_results import groups, write_run
from tigas_experiments.report.figures import latency_parts, over_rtt, overview, profiles
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.plot import panel_grid, plot_style
from tigas_experiments.report.run_table import load_results
from tigas_experiments.report.time_figures import (
    BINS,
    bandwidth,
    bin_medians,
    distribution,
    downloadable_megabytes,
    draw_boxes,
    heights_over_time,
    latencies,
)


def test_a_plot_takes_the_page_s_colours_and_is_well_formed(tmp_path: Path) -> None:
    with plot_style():
        plot = latencies(groups(tmp_path, {"network": "a & <b>"}), "a & <b>")
    assert plot is not None
    ElementTree.fromstring(plot.svg)
    assert "var(" not in plot.svg, "a file of its own has colours of its own"
    assert "fill: var(--ink)" in plot.markup
    assert "#1c2430" not in plot.markup


def test_an_unshaped_network_has_no_link_to_download_over(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", "seen", "unshaped", None, mode="dash-tuned")
    for name in ("link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    plot = bandwidth(Groups.from_runs(load_results(tmp_path).runs), "unshaped")
    assert plot is not None
    assert "DASH tuned" in plot.svg
    assert "Full link rate" not in plot.svg


def test_the_bandwidth_figure_compares_with_downloading_the_scene(tmp_path: Path) -> None:
    fast = bandwidth(groups(tmp_path / "fast", {"link_kbps": 80_000, "kbps": 4000}), "bus")
    slow = bandwidth(groups(tmp_path / "slow", {"link_kbps": 8000, "kbps": 4000}), "bus")
    assert fast is not None
    assert slow is not None
    assert "Full link rate" in slow.svg
    assert ("Scene file" in fast.svg, "Scene file" in slow.svg) == (True, False)


def test_the_resolution_over_time_is_of_each_controller_s_first_run(tmp_path: Path) -> None:
    found = groups(tmp_path, {"rungs": (1, 3), "hold": 50}, {"repeat": 1, "rungs": (0,)}, {"controller": "l2a"})
    plot = heights_over_time(found, "bus")
    assert plot is not None
    assert plot.caption.startswith("Over bus at 20 ms round trip, first run of each controller; medians")


def test_a_box_stands_over_its_controller_where_another_has_no_runs(tmp_path: Path) -> None:
    names = (("latency", 20.0), ("seen", 20.0), ("seen", 300.0))
    found = groups(tmp_path, *({"controller": name, "rtt_ms": rtt} for name, rtt in names))
    _, panels = panel_grid(2, share=True)
    for panel, rtt in zip(panels, (20.0, 300.0), strict=True):
        draw_boxes(panel, found.at("bus", rtt), found.looks)
    boxes = [[box.get_path().get_extents() for box in panel.patches] for panel in panels]
    assert [[round((box.x0 + box.x1) / 2, 9) for box in panel] for panel in boxes] == [[0, 1], [1]]
    assert [label.get_text() for label in panels[1].get_xticklabels()] == ["Latency", "Seen"]


def test_distributions_count_what_never_came() -> None:
    values, shares = distribution(np.array([30.0, 10.0, np.inf, 20.0]))
    assert (values.tolist(), shares.tolist()) == ([10, 20, 30], [0.25, 0.5, 0.75])
    values, shares = distribution(np.array([np.inf]))
    assert (values.tolist(), shares.tolist()) == ([], [])
    values, shares = distribution(np.arange(100_000.0))
    assert (len(values), values[0], values[-1], shares[-1]) == (200, 0, 99_999, 1.0)


def test_a_download_takes_what_the_link_carries() -> None:
    link = np.array([[0.5, 8.0], [1.0, 16.0], [1.5, 0.0]])
    assert downloadable_megabytes(link).tolist() == [0.5, 1.5, 1.5]


def test_long_series_are_drawn_by_their_medians() -> None:
    times = np.arange(10_000) / 100
    values = np.where(np.arange(10_000) % 10 == 0, 900.0, 40.0)
    binned_times, medians = bin_medians(times, values)
    assert len(binned_times) <= BINS
    assert set(medians.tolist()) == {40.0}
    assert bin_medians(times[:5], values[:5])[1].tolist() == [900, 40, 40, 40, 40]


def test_round_trips_are_compared_if_there_are_several(tmp_path: Path) -> None:
    assert over_rtt(groups(tmp_path / "one", {}, {"controller": "seen"}), "bus") is None
    runs = [{"rtt_ms": rtt, "delay_ms": 30 + rtt, "repeat": n} for rtt in (20.0, 50.0, 300.0) for n in (0, 1)]
    plot = over_rtt(groups(tmp_path / "three", *runs), "bus")
    assert plot is not None
    assert "Means over 2 runs" in plot.caption


def test_an_overview_is_at_the_lowest_round_trip(tmp_path: Path) -> None:
    plot = overview(groups(tmp_path, {}, {"rtt_ms": 300.0}))
    assert plot is not None
    assert plot.caption == "Each controller over each network, at its lowest round trip (20 ms). One run."


def test_streams_without_rungs_have_no_profiles(tmp_path: Path) -> None:
    assert profiles(groups(tmp_path, {"mode": "dash-tuned"}), "bus") is None


def test_the_parts_of_the_frame_age_are_stacked_by_controller_and_network(tmp_path: Path) -> None:
    every = groups(
        tmp_path,
        *(
            {"controller": name, "network": network, "delay_ms": took + 16, "reply_ms": took}
            for name, took in (("latency", 60.0), ("seen", 30.0))
            for network in ("bus", "train")
        ),
        {"mode": "dash-edge", "delay_ms": 80},
    )
    plot = latency_parts(every)
    assert plot is not None
    for text in ("Rendering", "Encoding", "Latency, train"):
        assert text in plot.svg
    assert "DASH" not in plot.svg, "it has no server times"
    parts = [METRICS[name] for name in ("age_network_ms", "age_page_ms", "age_render_ms")]
    means = [
        [found.mean for metric in parts if (found := group.estimate(metric))]
        for group in every
        if group.controller.name == "latency"
    ]
    assert means == [pytest.approx([60 - 12, 16, 11])] * 2
    assert latency_parts(groups(tmp_path / "without replies", {})) is None
