"""Scored pictures: matching ones and incomparable ones; scores.ndjson is read as strictly as every record."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.experiments.made_up import png
from tests.experiments.triplets_made_up import HEIGHT, WIDTH, jpeg, reduced, view, write_triplets
from tigas_experiments.quality.picture import BrokenPicture, encode
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.samples import JPEG, TRUTH, write_sample_file
from tigas_experiments.records.scores import SCORES, Score, read_scores, triplets, write_scores


def test_scores_are_kept_in_order(tmp_path: Path) -> None:
    assert read_scores(tmp_path) == []
    scores = [
        Score(seq=20, picture="original", digest="a", psnr=30.5),
        Score(seq=3, picture="original", digest="b"),
        Score(seq=3, picture="enhanced", digest="c", model="scene", dists=0.1),
    ]
    write_scores(tmp_path, scores)
    found = read_scores(tmp_path)
    assert [score.key for score in found] == [(3, "enhanced"), (3, "original"), (20, "original")]
    assert found[0].values == {"dists": 0.1}
    assert found[2].has(["psnr"])
    assert not found[2].has(["psnr", "ssim"])
    assert [path.name for path in tmp_path.iterdir()] == [SCORES]


@pytest.mark.parametrize(
    "line", ['{"seq": 1}', "rubbish", '{"seq": 1, "picture": "original", "digest": "a", "psnr": NaN}']
)
def test_rubbish_is_refused_with_its_line(tmp_path: Path, line: str) -> None:
    (tmp_path / SCORES).write_text(f'{{"seq": 1, "picture": "original", "digest": "a"}}\n{line}\n')
    with pytest.raises(BrokenRecording, match=r"scores.ndjson, line 2"):
        read_scores(tmp_path)


def test_pictures_belong_together_by_their_number(tmp_path: Path) -> None:
    assert triplets(tmp_path) == []
    write_triplets(tmp_path, 3)
    (tmp_path / "samples" / "000020.enhanced.png").unlink()
    write_sample_file(tmp_path, 7, TRUTH, png())
    write_sample_file(tmp_path, 8, JPEG, b"")
    write_sample_file(tmp_path, 10, "replayed.jpg", b"")
    (tmp_path / "samples" / "notes.txt").write_text("")
    found = triplets(tmp_path)
    assert [(each.seq, list(each.pictures)) for each in found] == [
        (10, ["enhanced", "original"]),
        (20, ["original"]),
        (30, ["enhanced", "original"]),
    ]
    assert found[0].pictures["original"].name == "000010.jpg"
    assert found[0].truth.name == "000010.truth.png"


def test_the_original_is_enlarged_by_bicubic(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1)
    truth, pictures = triplets(tmp_path)[0].read().decode()
    small = Image.open(tmp_path / "samples" / "000010.jpg")
    assert small.size == (WIDTH // 2, HEIGHT // 2)
    assert np.array_equal(truth, view(10))
    assert np.array_equal(pictures["original"], np.asarray(small.resize((WIDTH, HEIGHT), Image.Resampling.BICUBIC)))


def test_an_enhanced_picture_is_read_as_webp_too(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1, enhance=None)
    buffer = io.BytesIO()
    Image.fromarray(view(5)).save(buffer, "WEBP", lossless=True)
    write_sample_file(tmp_path, 10, "enhanced.webp", buffer.getvalue())
    _, pictures = triplets(tmp_path)[0].read().decode()
    assert np.array_equal(pictures["enhanced"], view(5))


def test_the_digest_is_of_both_pictures(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1)
    before = triplets(tmp_path)[0].read()
    write_sample_file(tmp_path, 10, TRUTH, encode(view(11)))
    after = triplets(tmp_path)[0].read()
    assert before.digest("original") != before.digest("enhanced")
    assert {before.digest(kind) for kind in before.pictures}.isdisjoint({after.digest(kind) for kind in after.pictures})


def test_a_picture_that_was_shown_at_another_size_is_not_compared(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1, enhance=lambda _, truth: reduced(truth, 2))
    with pytest.raises(BrokenPicture, match=r"shown at 64×36, but its ground truth has 128×72 pixels"):
        triplets(tmp_path)[0].read().decode()


@pytest.mark.parametrize(("width", "height"), [(16, 200), (4096, 2200)])
def test_ground_truth_that_is_too_small_or_too_large(tmp_path: Path, width: int, height: int) -> None:
    write_sample_file(tmp_path, 1, JPEG, jpeg(view(), 50))
    write_sample_file(tmp_path, 1, TRUTH, encode(np.zeros((height, width, 3), np.uint8)))
    with pytest.raises(BrokenPicture, match=f"{width}×{height} pixels; 32×32 to 3840×2160 can be compared"):
        triplets(tmp_path)[0].read().decode()


def test_what_is_no_file_or_too_large_for_one(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1)
    truth = tmp_path / "samples" / "000010.truth.png"
    os.truncate(truth, 64_000_001)
    with pytest.raises(BrokenRecording, match=r"truth\.png cannot be read"):
        triplets(tmp_path)[0].read()
    truth.unlink()
    os.mkfifo(truth)
    with pytest.raises(BrokenRecording, match="Not a regular file"):
        triplets(tmp_path)[0].read()
