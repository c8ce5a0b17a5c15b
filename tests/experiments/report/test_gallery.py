"""The samples in a report: selection, size, distance from ground truth, and notices."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.experiments.samples.renderers import FakeRenderer, picture, sampled_run
from tigas_experiments.quality.picture import Picture
from tigas_experiments.records.samples import JPEG, RERENDERED, TRUTH, sample_path, write_sample_file, write_samples
from tigas_experiments.records.scores import Score, write_scores
from tigas_experiments.report.gallery import MAX_SAMPLES, GallerySample, gallery
from tigas_experiments.report.report import write_report
from tigas_experiments.report.run_table import load_results
from tigas_experiments.report.warnings import collect_warnings
from tigas_experiments.samples.rerender import rerender

pytestmark = pytest.mark.anyio


async def made(folder: Path, runs: int = 1, samples: int = 4, shade: int = 0) -> None:
    async with FakeRenderer(shade).client() as renderer:
        for number in range(runs):
            run = folder / "runs" / f"{number:02}"
            sampled_run(run, range(1, samples + 1), repeat=number)
            await rerender(run, renderer)


def shown(folder: Path) -> list[GallerySample]:
    return gallery(load_results(folder).runs)


def decoded(url: str) -> Picture:
    data = base64.b64decode(url.removeprefix("data:image/webp;base64,"))
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


async def test_a_frame_stands_beside_ground_truth_in_its_size(tmp_path: Path) -> None:
    await made(tmp_path, samples=1)
    (one,) = shown(tmp_path)
    assert (one.title, one.remark, one.width, one.height) == ("00, 1", None, 64, 36)
    assert one.about == "shown at 0.0 s, 20.0 kB, rung 2"
    assert [each.name for each in one.pictures] == ["received", "ground truth", "received, difference × 4"]
    assert {decoded(each.url).shape for each in one.pictures} == {(36, 64, 3)}


async def test_the_difference_is_from_ground_truth_and_the_enhanced_picture_has_its_own(tmp_path: Path) -> None:
    """A frame with a blue error of 20, and a perfect enhanced picture."""
    await made(tmp_path, samples=1)
    run = tmp_path / "runs" / "00"
    write_sample_file(run, 1, JPEG, picture(1, 64, 36, "PNG", 20))
    write_sample_file(run, 1, "enhanced.png", sample_path(run, 1, TRUTH).read_bytes())
    (one,) = shown(tmp_path)
    names = {each.name: decoded(each.url) for each in one.pictures}
    assert list(names) == [
        "received",
        "enhanced",
        "ground truth",
        "received, difference × 4",
        "enhanced, difference × 4",
    ]
    assert names["received, difference × 4"][..., 2].mean() == pytest.approx(80, abs=3)
    assert names["enhanced, difference × 4"].max() <= 1


async def test_scores_stand_below_their_pictures(tmp_path: Path) -> None:
    await made(tmp_path, samples=2)
    score = Score(seq=1, picture="original", digest="0", psnr=31.26, ssim=0.9127)
    write_scores(tmp_path / "runs" / "00", [score, score.model_copy(update={"seq": 2, "psnr": 20.0})])
    (one, _) = shown(tmp_path)
    assert [each.scores for each in one.pictures] == ["PSNR 31.3 dB, SSIM 0.913", "", ""]
    assert "received<br>PSNR 31.3 dB" in write_report(tmp_path, tmp_path).page.read_text()


async def test_there_are_a_few_from_many_runs(tmp_path: Path) -> None:
    await made(tmp_path, runs=MAX_SAMPLES + 3, samples=5)
    found = shown(tmp_path)
    assert len(found) == MAX_SAMPLES
    assert len({one.title.split(",")[0] for one in found}) == MAX_SAMPLES
    (tmp_path / "few").mkdir()
    await made(tmp_path / "few", runs=2, samples=5)
    assert [one.title for one in shown(tmp_path / "few")] == ["00, 1", "01, 1", "00, 3", "01, 3", "00, 5", "01, 5"]


async def test_what_is_broken_or_not_rendered_is_left_out(tmp_path: Path) -> None:
    await made(tmp_path, samples=4)
    run = tmp_path / "runs" / "00"
    sample_path(run, 1, TRUTH).unlink()
    sample_path(run, 2, JPEG).write_bytes(b"\xff\xd8")
    sample_path(run, 3, TRUTH).write_bytes(sample_path(run, 3, TRUTH).read_bytes()[:60])
    assert [one.title for one in shown(tmp_path)] == ["00, 4"]


async def test_a_report_says_where_the_renderer_answered_differently(tmp_path: Path) -> None:
    await made(tmp_path, samples=3, shade=60)
    report = write_report(tmp_path, tmp_path)
    page = report.page.read_text()
    assert report.warnings[-1].startswith("00: rendering again gave different frames for 3 of 3 samples")
    assert len(re.findall(r"Rendering it again gave a different frame \([\d.]+ dB apart\)", page)) == 3
    assert '<b class="remark">3 different</b>' in page
    assert "<h2>Samples</h2>" in page


async def test_what_is_missing_is_said_and_samples_are_not_needed(tmp_path: Path) -> None:
    await made(tmp_path, samples=3)
    run = tmp_path / "runs" / "00"
    (run / RERENDERED).unlink()
    missing = "3 of 3 samples have not been rendered again yet: run `tigas experiment rerender DIR`."
    assert (missing in collect_warnings(load_results(tmp_path)), shown(tmp_path)) == (True, [])
    write_samples(run, [])
    assert not any("sample" in warning for warning in collect_warnings(load_results(tmp_path)))
    assert "<h2>Samples</h2>" not in write_report(tmp_path, tmp_path).page.read_text()
