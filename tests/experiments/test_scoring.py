"""Scoring a run's samples: all metrics, reuse of scores, and incomparable samples."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.experiments.triplets_made_up import view, write_triplets
from tigas_experiments.quality.metrics import PICTURE_METRICS, Meter, Meters, distance
from tigas_experiments.quality.perceptual import Dists, Lpips
from tigas_experiments.quality.picture import Picture, encode
from tigas_experiments.records.samples import TRUTH, write_sample_file
from tigas_experiments.records.scores import read_scores
from tigas_experiments.scoring import Scoring


class Counted:
    """A metric that says how bright a picture is, and counts how many it has seen."""

    def __init__(self, breaks_after: int = 10**9) -> None:
        self.seen = 0
        self.breaks_after = breaks_after

    def __call__(self, pictures: Sequence[Picture], truth: Picture) -> list[tuple[float, ...]]:
        if self.seen >= self.breaks_after:
            raise KeyboardInterrupt
        self.seen += len(pictures)
        return [(float(picture.mean()), 0.5) for picture in pictures]

    @property
    def meters(self) -> Meters:
        """It alone, under the names of the two that come together."""
        return Meters([Meter(("psnr", "ssim"), self)])


@pytest.mark.slow
def test_all_six_metrics_of_both_pictures(tmp_path: Path) -> None:
    torch.manual_seed(1)
    meters = Meters.create(["psnr", "ssim", "vmaf", "vif"], "cpu")
    meters.single += [Meter(("lpips",), distance(Lpips(), "cpu")), Meter(("dists",), distance(Dists(), "cpu"))]
    scoring = Scoring(write_triplets(tmp_path, 2), meters)
    scores = {score.key: score for score in scoring.score()}
    assert {score.key: score for score in read_scores(tmp_path)} == scores
    for seq in (10, 20):
        original, enhanced = scores[seq, "original"], scores[seq, "enhanced"]
        assert set(original.values) == {"psnr", "ssim", "vmaf", "vif", "lpips", "dists"} == set(enhanced.values)
        for metric in PICTURE_METRICS:
            before, after = original.values[metric.name], enhanced.values[metric.name]
            assert after > before if metric.better == "high" else after < before, metric.title
        assert (original.model, enhanced.model) == (None, "scene")


def test_what_was_scored_is_not_scored_again(tmp_path: Path) -> None:
    write_triplets(tmp_path, 2)
    first = Scoring(tmp_path, Counted().meters).score()
    counted = Counted()
    assert Scoring(tmp_path, counted.meters).score() == first
    assert counted.seen == 0
    Scoring(tmp_path, counted.meters, again=True).score()
    assert counted.seen == 4


def test_scoring_again_keeps_other_metrics_and_what_it_does_not_reach(tmp_path: Path) -> None:
    write_triplets(tmp_path, 2)
    Scoring(tmp_path, Counted().meters).score()
    Scoring(tmp_path, Meters.create(["vif"], "cpu")).score()
    before = read_scores(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        Scoring(tmp_path, Counted(breaks_after=2).meters, again=True).score()
    assert read_scores(tmp_path) == before
    for path in (tmp_path / "samples").iterdir():
        path.unlink()
    Scoring(tmp_path, Counted().meters, again=True).score()
    assert read_scores(tmp_path) == before, "a run without pictures"


def test_a_metric_that_is_asked_for_later_is_added(tmp_path: Path) -> None:
    write_triplets(tmp_path, 2)
    Scoring(tmp_path, Counted().meters).score()
    Scoring(tmp_path, Meters.create(["vif"], "cpu")).score()
    assert all(score.has(["psnr", "ssim", "vmaf", "vif"]) for score in read_scores(tmp_path))


def test_pictures_that_were_replaced_are_scored_anew(tmp_path: Path) -> None:
    write_triplets(tmp_path, 2)
    before = {score.key: score for score in Scoring(tmp_path, Counted().meters).score()}
    write_sample_file(tmp_path, 20, "enhanced.png", encode(view(77)))
    (tmp_path / "samples" / "000010.enhanced.png").unlink()
    counted = Counted()
    after = {score.key: score for score in Scoring(tmp_path, counted.meters).score()}
    assert counted.seen == 1
    assert after.keys() == before.keys() - {(10, "enhanced")}
    assert after[20, "original"] == before[20, "original"]
    assert after[20, "enhanced"].psnr == pytest.approx(float(view(77).mean()))


def test_an_interrupted_command_goes_on_where_it_was(tmp_path: Path) -> None:
    write_triplets(tmp_path, 3)
    with pytest.raises(KeyboardInterrupt):
        Scoring(tmp_path, Counted(breaks_after=4).meters).score()
    assert sum(score.psnr is not None for score in read_scores(tmp_path)) == 4
    counted = Counted()
    assert len(Scoring(tmp_path, counted.meters).score()) == 6
    assert counted.seen == 2


def test_samples_that_cannot_be_compared_are_named_and_cost_nothing_else(tmp_path: Path) -> None:
    write_triplets(tmp_path, 4)
    write_sample_file(tmp_path, 20, TRUTH, b"\x89PNG rubbish")
    write_sample_file(tmp_path, 30, "enhanced.png", encode(np.zeros((50, 50, 3), np.uint8)))
    scoring = Scoring(tmp_path, Meters.create(["psnr", "vif"], "cpu"))
    scores = scoring.score()
    assert {score.seq for score in scores} == {10, 40}
    assert list(scoring.problems) == ["sample 20", "sample 30"]
    assert "cannot be read" in scoring.problems["sample 20"]
    assert "shown at 50×50" in scoring.problems["sample 30"]
    assert all(score.has(["psnr", "ssim", "vmaf", "vif"]) for score in scores)


def test_a_sequence_may_change_its_size(tmp_path: Path) -> None:
    write_triplets(tmp_path, 3, enhance=None)
    write_sample_file(tmp_path, 20, TRUTH, encode(view(20, 96, 54)))
    scores = Scoring(tmp_path, Meters.create(["vif"], "cpu")).score()
    assert [score.seq for score in scores if score.vif is not None] == [10, 20, 30]


def test_how_far_it_is(tmp_path: Path) -> None:
    write_triplets(tmp_path, 3)
    told: list[int] = []
    scoring = Scoring(tmp_path, Meters.create(["ssim", "vmaf"], "cpu"), told.append)
    scoring.score()
    assert sum(told) == scoring.steps == 6


def test_what_was_seen_is_scored_on_black_beside_the_samples(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1, enhance=None)
    (tmp_path / "captures").mkdir()
    shown = np.dstack((view(1), np.full(view(1).shape[:2], 255, np.uint8)))
    for number in range(3):
        shown[:, : 20 * number, 3] = 0  # never seen
        (tmp_path / "captures" / f"000{number}.png").write_bytes(encode(shown))
        (tmp_path / "captures" / f"000{number}.truth.png").write_bytes(encode(view(1)))
    (tmp_path / "captures" / "view.png").write_bytes(encode(view(1)))
    scores = Scoring(tmp_path, Meters.create(["psnr", "ssim"], "cpu")).score()
    assert [score.key for score in read_scores(tmp_path)] == [(0, "seen"), (1, "seen"), (2, "seen"), (10, "original")]
    whole, less, least = (score.psnr or 0.0 for score in scores if score.picture == "seen")
    assert whole == 100 > less > least
    counted = Counted()
    assert len(Scoring(tmp_path, counted.meters).score()) == 4
    assert counted.seen == 0, "once"
