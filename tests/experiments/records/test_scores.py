"""scores.ndjson: written whole, and read as strictly as every record."""

from __future__ import annotations

from pathlib import Path

import pytest

from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.scores import SCORES, Score, read_scores, write_scores


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


def test_new_values_are_added() -> None:
    score = Score(seq=1, picture="original", digest="a", psnr=30.0).with_values({"ssim": 0.9})
    assert score.values == {"psnr": 30.0, "ssim": 0.9}


@pytest.mark.parametrize(
    "line", ['{"seq": 1}', "rubbish", '{"seq": 1, "picture": "original", "digest": "a", "psnr": NaN}']
)
def test_rubbish_is_refused_with_its_line(tmp_path: Path, line: str) -> None:
    (tmp_path / SCORES).write_text(f'{{"seq": 1, "picture": "original", "digest": "a"}}\n{line}\n')
    with pytest.raises(BrokenRecording, match=r"scores.ndjson, line 2"):
        read_scores(tmp_path)
