"""Scores of sampled pictures in a report: means, deviations, differences, heat maps and their CSV file."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiments.report.synthetic_results import rows as csv_rows
from tests.experiments.report.synthetic_results import text_of, write_run
from tigas_experiments.quality.metrics import DISTS, LPIPS, PSNR
from tigas_experiments.records.scores import Score, write_scores
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.picture_scores import score_rows
from tigas_experiments.report.plot import Plot
from tigas_experiments.report.quality_figures import enhancement_heat_map, quality_heat_map
from tigas_experiments.report.report import write_report
from tigas_experiments.report.run_table import load_results


def scores(psnr: float, gain: float, lpips: float = 0.3) -> list[Score]:
    """Scores of three samples: PSNR around a mean, and an enhancement that adds to it."""
    found = []
    for seq, around in enumerate((psnr - 1, psnr, psnr + 1)):
        found.append(Score(seq=seq, picture="original", digest="o", psnr=around, lpips=lpips))
        better = {"psnr": around + gain, "lpips": lpips - gain / 100}
        found.append(Score(seq=seq, picture="enhanced", digest="e", model="scene", **better))
    return found


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Two controllers over two networks, of one of which some samples have scores."""
    for name, psnr in (("latency", 30.0), ("seen", 33.0)):
        for network, less in (("bus", 0.0), ("train", 4.0)):
            run = write_run(tmp_path / "runs" / f"{name}-{network}", name, network, 20.0)
            write_scores(run, scores(psnr - less, 1.5, lpips=1 - psnr / 50))
    return tmp_path


def test_means_deviations_and_differences() -> None:
    first, second = scores(30, 2), scores(40, 4)
    original, enhanced, difference = score_rows([(None, first), (None, second)])
    assert [row.kind for row in (original, enhanced, difference)] == ["original", "enhanced", "difference"]
    assert (original.model, enhanced.model, difference.model) == (None, "scene", "scene")
    assert original.runs == enhanced.runs == difference.runs == 2
    mean = original.mean(PSNR)
    assert mean is not None
    assert (mean.mean, mean.pictures) == (35, 6)
    assert mean.deviation == pytest.approx(5.55, abs=0.01)
    gain = difference.mean(PSNR)
    assert gain is not None
    assert gain.mean == pytest.approx(3)
    assert gain.text(PSNR, signed=True) == "+3.0 ± 1.1"
    assert original.mean(DISTS) is None


def test_a_difference_is_of_the_same_sample() -> None:
    scored = [
        Score(seq=1, picture="original", digest="a", psnr=20),
        Score(seq=2, picture="original", digest="a", psnr=40),
        Score(seq=2, picture="enhanced", digest="a", psnr=41, model="a"),
        Score(seq=3, picture="enhanced", digest="a", psnr=90, model="b"),
    ]
    found = score_rows([(None, scored)])
    assert [(row.kind, row.model, row.values["psnr"]) for row in found] == [
        ("original", None, [20, 40]),
        ("enhanced", "a", [41]),
        ("enhanced", "b", [90]),
        ("difference", "a", [1]),
    ]


def heat_maps(experiment: Path) -> tuple[Plot | None, Plot | None]:
    groups = Groups.from_runs(load_results(experiment).runs)
    return quality_heat_map(groups), enhancement_heat_map(groups)


def test_the_heat_maps_show_scores_and_what_enhancement_gains(experiment: Path) -> None:
    quality, enhancement = heat_maps(experiment)
    assert quality is not None
    for text in ("PSNR, dB (higher is better)", "LPIPS (lower is better)", "33.0", "26.0", "± 1.0", "bus", "20 ms"):
        assert text in quality.svg
    assert "LPIPS: v0.1, AlexNet" in quality.caption
    assert enhancement is not None
    assert "+1.5" in enhancement.svg
    assert "scene" in enhancement.svg


@pytest.mark.parametrize(("gain", "is_better"), [(-3, False), (3, True)])
def test_worse_pictures_have_the_colour_of_worse(experiment: Path, gain: float, is_better: bool) -> None:
    write_scores(experiment / "runs" / "latency-bus", scores(30, gain))
    _, enhancement = heat_maps(experiment)
    assert enhancement is not None
    better, worse = "#053061", "#67001f"
    assert (better in enhancement.svg, worse in enhancement.svg) == (is_better, not is_better)


def test_networks_whose_shortened_names_are_equal_have_a_line_each(tmp_path: Path) -> None:
    names = [f"a-trace-of-a-long-name-{place}-recorded-on-a-bus" for place in ("A", "B")]
    for name, psnr in zip(names, (21.0, 42.0), strict=True):
        write_scores(write_run(tmp_path / "runs" / name, "latency", name), scores(psnr, 1))
    quality, _ = heat_maps(tmp_path)
    assert quality is not None
    assert "21.0" in quality.svg
    assert "42.0" in quality.svg


def test_without_scores_or_enhancement_there_is_less(experiment: Path) -> None:
    for run in (experiment / "runs").iterdir():
        write_scores(run, [score for score in scores(30, 0) if score.picture == "original"])
    quality, enhancement = heat_maps(experiment)
    assert (quality is None, enhancement is None) == (False, True)
    for run in (experiment / "runs").iterdir():
        write_scores(run, [])
    assert heat_maps(experiment) == (None, None)


@pytest.mark.slow
def test_the_report_has_them_with_their_values(experiment: Path) -> None:
    page = write_report(experiment, experiment).page
    assert (experiment / "quality-heatmap.svg").exists()
    assert (experiment / "enhancement-heatmap.svg").exists()
    assert "Effect of enhancement" in text_of(page.read_text())
    found = csv_rows(experiment / "picture_scores.csv")
    assert len(found) == 4 * 3 * 2
    names = ("network", "controller", "picture", "metric")
    (row,) = [each for each in found if [each[n] for n in names] == ["train", "seen", "difference", LPIPS.name]]
    assert float(row["mean"]) == pytest.approx(-0.015)
    assert (row["rtt_ms"], row["model"], row["runs"], row["pictures"]) == ("20.0", "scene", "1", "3")
