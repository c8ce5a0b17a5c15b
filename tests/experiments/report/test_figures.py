"""The figures: which are drawn, what their titles say, and that large experiments stay small and quick."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.experiments.report.made_up_results import write_large, write_run
from tigas_common.wire.run import Configuration, Mode
from tigas_experiments.report import experiment
from tigas_experiments.report.drawing import distribution, for_a_page
from tigas_experiments.report.experiment import Listener, write_experiment_report
from tigas_experiments.report.figures import Draughtsman
from tigas_experiments.report.findings import short
from tigas_experiments.report.marks import draw_boxes
from tigas_experiments.report.panels import panel_grid
from tigas_experiments.report.results import load
from tigas_experiments.report.series import BINS, binned, downloaded
from tigas_experiments.report.variants import Variant, in_order, looks


def drawn(folder: Path, *runs: dict[str, Any]) -> Draughtsman:
    """A draughtsman of runs."""
    for number, run in enumerate(runs):
        write_run(folder / "runs" / f"{number:02}", **run)
    return Draughtsman(load(folder))


def test_one_round_trip_needs_no_figure_of_round_trips(tmp_path: Path) -> None:
    draughtsman = drawn(tmp_path, {}, {"controller": "budget"})
    assert draughtsman.over_rtt("bus") is None
    assert draughtsman.latencies("bus") is not None


def test_round_trips_are_told_from_end_to_end(tmp_path: Path) -> None:
    runs = [{"rtt_ms": rtt, "delay_ms": 30 + rtt, "repeat": n} for rtt in (20.0, 50.0, 300.0) for n in (0, 1)]
    drawing = drawn(tmp_path, *runs).over_rtt("bus")
    assert drawing is not None
    assert drawing.title == "Mean response at 20 ms round trip: Latency 50 ms; at 300 ms: Latency 330 ms"
    assert "Means over 2 runs" in drawing.caption


def test_a_box_stands_over_its_controller_where_another_has_no_runs(tmp_path: Path) -> None:
    for number, (name, rtt) in enumerate((("latency", 20.0), ("budget", 20.0), ("budget", 300.0))):
        write_run(tmp_path / "runs" / f"{number}", name, rtt_ms=rtt)
    results = load(tmp_path)
    _, panels = panel_grid(2, share=True)
    for panel, rtt in zip(panels, (20.0, 300.0), strict=True):
        draw_boxes(panel, results.at("bus", rtt), looks(results.variants))
    boxes = [[box.get_path().get_extents() for box in panel.patches] for panel in panels]
    assert [[round((box.x0 + box.x1) / 2, 9) for box in panel] for panel in boxes] == [[0, 1], [1]]
    assert [label.get_text() for label in panels[1].get_xticklabels()] == ["Latency", "Budget"]


def test_a_caption_says_what_is_taken_together(tmp_path: Path) -> None:
    drawing = drawn(tmp_path, {}, {"movement": "orbit"}, {"movement": "orbit", "repeat": 1}).overview()
    assert drawing is not None
    assert "at its lowest round trip (20 ms). Means over 3 runs (2 movements), from the least to" in drawing.caption


def test_runs_over_an_unshaped_network_without_pictures_or_rungs(tmp_path: Path) -> None:
    path = write_run(tmp_path / "runs" / "a", "budget", "unshaped", None, mode="dash-tuned")
    for name in ("link", "quality"):
        (path / f"{name}.ndjson").write_text("")
    draughtsman = Draughtsman(load(tmp_path))
    assert draughtsman.profiles("unshaped") is None
    bandwidth = draughtsman.bandwidth("unshaped")
    assert bandwidth is not None
    assert bandwidth.title == "Received: DASH tuned 2.0 MB"


@pytest.mark.parametrize(
    ("link_kbps", "words"),
    [
        (80_000, "the scene's 10.0 MB would have been downloaded after 1.0 s"),
        (8000, "of the scene's 10.0 MB, 20 % could have been downloaded in that time"),
    ],
)
def test_streaming_is_held_against_downloading(tmp_path: Path, link_kbps: float, words: str) -> None:
    drawing = drawn(tmp_path, {"link_kbps": link_kbps, "kbps": 4000}).bandwidth("bus")
    assert drawing is not None
    assert drawing.title == f"Received: Latency 1.0 MB; {words}"


def test_a_download_takes_what_the_link_carries() -> None:
    link = np.array([[0.5, 8.0, 0.0], [1.0, 16.0, 0.0], [1.5, 0.0, 0.0]])
    assert downloaded(link).tolist() == [0.5, 1.5, 1.5]


def test_the_overview_names_the_best_and_the_worst(tmp_path: Path) -> None:
    drawing = drawn(tmp_path, {"controller": "latency", "delay_ms": 130}, {"controller": "budget"}).overview()
    assert drawing is not None
    assert drawing.title == "Budget has the most inputs within 100 ms, 100.0 % on average; Latency the fewest, 0.0 %"


def test_names_are_shortened_in_their_middle() -> None:
    assert short("report_bus_0001") == "report_bus_0001"
    assert short("driving_B_2019.12.16_14.23.32.csv.gz") == "driving_B…2.csv.gz"
    assert len(short("x" * 100)) == 18


def test_distributions_count_what_never_came() -> None:
    values, shares = distribution([30.0, 10.0, float("inf"), 20.0])
    assert (values, shares) == ([10, 20, 30], [0.25, 0.5, 0.75])
    assert distribution([float("inf")]) == ([], [])
    values, shares = distribution(range(100_000))
    assert (len(values), values[0], values[-1], shares[-1]) == (200, 0, 99_999, 1.0)


def test_long_series_are_drawn_by_their_medians() -> None:
    times = np.arange(10_000) / 100
    values = np.where(np.arange(10_000) % 10 == 0, 900.0, 40.0)
    binned_times, medians = binned(times, values)
    assert len(binned_times) <= BINS + 1
    assert set(medians.tolist()) == {40.0}
    assert binned(times[:5], values[:5])[1].tolist() == [900, 40, 40, 40, 40]


def test_a_controller_looks_the_same_in_every_report() -> None:
    def variant(mode: Mode = "stateless", profile: int | str = "budget") -> Variant:
        return Variant.of(
            Configuration.model_validate(
                {
                    "scene": "s",
                    "movement": "stroll",
                    "network": {"trace": "x"},
                    "mode": mode,
                    "profile": profile,
                    "duration_s": 1.0,
                    "width": 64,
                    "height": 64,
                }
            )
        )

    budget, mine = variant(), variant(profile="mine")
    some = {
        budget,
        variant("dash-tuned"),
        variant("dash-tuned", "latency"),
        mine,
        variant(profile=3),
        variant(profile=0),
    }
    assert [each.title for each in in_order(some)] == ["Budget", "mine", "Profile 0", "Profile 3", "DASH tuned"]
    found = looks(some)
    assert found[budget] == looks([budget])[budget]
    assert len({(look.colour, look.dashes, look.marker) for look in found.values()}) == len(found)


def test_a_drawing_takes_the_page_s_colours_and_is_well_formed(tmp_path: Path) -> None:
    drawing = drawn(tmp_path, {"network": "a & <b>"}).latencies("a & <b>")
    assert drawing is not None
    ElementTree.fromstring(drawing.svg)
    assert "var(" not in drawing.svg, "a file of its own has colours of its own"
    assert "fill: var(--ink)" in for_a_page(drawing.svg)
    assert "#1c2430" not in for_a_page(drawing.svg)


def test_a_large_experiment_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "MOST_NETWORKS", 1)
    count = write_large(tmp_path, ("first", "second"), (20, 50), 1, seconds=20.0)
    assert count == 24
    read: list[tuple[int, int]] = []
    figures: list[str] = []
    report = write_experiment_report(
        tmp_path, tmp_path, Listener(lambda done, total: read.append((done, total)), figures.append)
    )
    assert read[-1] == (24, 24)
    assert len(figures) == 1 + 6, "one network is drawn by itself"
    assert "Only the first 1 of 2 networks" in report.page.read_text()
    assert report.page.stat().st_size < 1_000_000, "however long the runs are"
    assert len(report.results.groups) == 24
