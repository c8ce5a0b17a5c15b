"""Quality against rate: curves through fixed rungs, and differences where rates are equal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.experiments.report.synthetic_results import groups, rows, write_run
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.metrics import METRICS
from tigas_experiments.report.rate_distortion import EqualRate, by_condition, over_all
from tigas_experiments.report.report import write_report
from tigas_experiments.report.run_table import load_results

SSIM = METRICS["seen_ssim"]
LADDER: list[dict[str, Any]] = [
    {"controller": 2, "kbps": 1000, "view_ssim": 0.5},
    {"controller": 1, "kbps": 4000, "view_ssim": 0.7},
]
"""0.1 more with each doubling of the rate."""


def stream(kbps: int, view_ssim: float, **changes: Any) -> dict[str, Any]:
    """A DASH stream with an adaptive player."""
    return {"mode": "dash-tuned", "kbps": kbps, "view_ssim": view_ssim, **changes}


def fixed(kbps: int, view_ssim: float) -> dict[str, Any]:
    return stream(kbps, view_ssim, dash_representation={"rung": 2, "bitrate_kbps": kbps})


def compared(folder: Path, *runs: dict[str, Any]) -> list[EqualRate]:
    """Series of the only network against the curves."""
    (found,) = by_condition(groups(folder, *runs))
    return found.equal_rates


def difference(one: EqualRate) -> float:
    estimate = one.estimate(SSIM)
    assert estimate is not None
    return estimate.mean


def test_what_adapts_is_held_against_the_ladder_at_its_own_rate(tmp_path: Path) -> None:
    (one,) = compared(tmp_path, *LADDER, stream(2000, 0.55))
    assert (one.labels, one.no_overlap) == (["Fixed rungs", "DASH tuned", "2.0", "1 of 1"], "")
    assert difference(one) == pytest.approx(-0.05), "the ladder has 0.6 at 2 Mbit/s"


def test_two_curves_are_compared_over_the_rates_that_both_have(tmp_path: Path) -> None:
    (one,) = compared(tmp_path, *LADDER, fixed(2000, 0.8), fixed(8000, 1.0))
    assert one.labels == ["Fixed rungs", "DASH tuned, fixed", "2.0–4.0", "1 of 1"]
    assert difference(one) == pytest.approx(0.2), "as both rise alike from 2 to 4 Mbit/s"


def test_enhanced_pictures_have_a_curve_of_their_own(tmp_path: Path) -> None:
    enhanced = [{**each, "upscale": "scene", "view_ssim": each["view_ssim"] + 0.1} for each in LADDER]
    (one,) = compared(tmp_path, *LADDER, *enhanced)
    assert one.labels[:2] == ["Fixed rungs", "Fixed rungs + scene"]
    assert difference(one) == pytest.approx(0.1)


def test_rates_that_do_not_overlap_give_no_difference_and_it_is_said(tmp_path: Path) -> None:
    (one,) = compared(tmp_path, *LADDER, stream(5000, 0.9))
    assert (one.estimate(SSIM), one.rates, one.blocks, len(one.ranges)) == (None, None, 1, 0)
    assert one.no_overlap == "no overlap: Fixed rungs 1.0–4.0, DASH tuned 5.0 Mbit/s"
    assert one.no_overlap in write_report(tmp_path, tmp_path).page.read_text()


def test_a_single_rung_is_no_curve(tmp_path: Path) -> None:
    assert compared(tmp_path, LADDER[0], stream(1000, 0.9)) == []


def test_blocks_are_compared_one_by_one(tmp_path: Path) -> None:
    runs = [
        {**run, "movement": f"walk-{block}", "view_ssim": run["view_ssim"] - 0.1 * block}
        for block in range(6)
        for run in (*LADDER, stream(9000 if block == 5 else 2000, 0.7 + 0.01 * block))
    ]
    (one,) = compared(tmp_path, *runs, stream(9000, 0.7, movement="walk-4", repeat=1))
    assert (one.blocks, len(one.ranges)) == (6, 4), "block 5, and 4 by the mean of its repeats, are beyond the ladder"
    assert difference(one) == pytest.approx(0.115), "0.1 to 0.13, as blocks 0 to 3 differ among themselves alike"
    estimate = one.estimate(SSIM)
    assert estimate is not None
    assert estimate.interval is None, "four are too few"


def test_twelve_windows_give_an_interval(tmp_path: Path) -> None:
    runs = [{**run, "offset_s": 10.0 * window} for window in range(12) for run in (*LADDER, stream(2000, 0.5))]
    (one,) = compared(tmp_path, *runs)
    estimate = one.estimate(SSIM)
    assert estimate is not None
    assert estimate.interval == pytest.approx((-0.1005, -0.0995))


def test_all_networks_need_a_controller_everywhere(tmp_path: Path) -> None:
    bus = [*LADDER, stream(2000, 0.6)]
    tram = [{**run, "network": "tram"} for run in (*LADDER, {"controller": "seen", "kbps": 2000})]
    everywhere = over_all(groups(tmp_path, *bus, *tram))
    assert everywhere is not None
    assert [series.title for series in everywhere.series] == ["Fixed rungs"]
    assert over_all(groups(tmp_path / "one", *bus)) is None


@pytest.mark.slow
def test_the_values_are_in_csv_files_and_the_page(tmp_path: Path) -> None:
    groups(tmp_path, *LADDER, stream(2000, 0.55), {**LADDER[0], "network": "tram"})
    page = write_report(tmp_path, tmp_path).page.read_text()
    columns = ("network", "controller", "received_mbit_s", "seen_ssim")
    assert [tuple(row[name] for name in columns) for row in rows(tmp_path / "runs.csv")] == [
        ("bus", "profile-2", "1.0", "0.5"),
        ("bus", "profile-1", "4.0", "0.7"),
        ("bus", "dash-tuned", "2.0", "0.55"),
        ("tram", "profile-2", "1.0", "0.5"),
    ]
    (seen,) = [row for row in rows(tmp_path / "equal_rates.csv") if row["figure"] == "seen_ssim"]
    assert (seen["network"], seen["curve"], seen["compared"]) == ("bus", "Fixed rungs", "DASH tuned")
    assert float(seen["difference"]) == pytest.approx(-0.05)
    assert "Quality at equal rates" in page
    assert "-0.050" in page
    assert (tmp_path / "01-bus_rate-distortion.svg").is_file()


def test_runs_without_pictures_have_no_curve(tmp_path: Path) -> None:
    (write_run(tmp_path / "runs" / "a") / "quality.ndjson").write_text("")
    assert by_condition(Groups.from_runs(load_results(tmp_path).runs)) == []


def test_rates_that_print_alike_are_one(tmp_path: Path) -> None:
    (one,) = compared(tmp_path, *LADDER, stream(2000, 0.55), stream(2020, 0.55, movement="orbit"))
    assert one.labels[2] == "2.0"
