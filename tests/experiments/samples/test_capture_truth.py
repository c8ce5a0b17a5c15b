"""Ground truth of kept pictures, rendered again: of the pose that the viewer had, once, and by the same renderer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiments.made_up import inputs, write_run
from tests.experiments.samples.renderers import FakeRenderer, picture
from tigas_experiments.quality.picture import CaptureQuality, compare, decode
from tigas_experiments.records.files import write_lines
from tigas_experiments.records.folder import StoredRun, capture_path
from tigas_experiments.records.samples import TRUTH
from tigas_experiments.records.scores import Score, write_scores
from tigas_experiments.records.summary import summarise
from tigas_experiments.samples.capture_truth import render_truth
from tigas_experiments.wire.recording import Capture, Input

pytestmark = pytest.mark.anyio
LATE = 4
"""At 90 ms the viewer is at x = 4; the picture is from x = 1."""


def kept_run(folder: Path) -> Path:
    """With two pictures: one from before the movement."""
    run = write_run(folder)
    shown = picture(1, 64, 36, "PNG")
    taken = [Capture(at=at, shown_at=at, pose=2, rung=2, width=64, height=36) for at in (-10.0, 90.0)]
    write_lines(run / "captures.ndjson", taken)
    for index in range(2):
        capture_path(run, index).write_bytes(shown)
    seen = compare(decode(shown), decode(picture(LATE, 64, 36, "PNG")))
    quality = CaptureQuality(at=90.0, pose=2, rung=2, picture=None, view=None, seen=seen)
    write_lines(run / "quality.ndjson", [quality])
    assert StoredRun(run).read(Input)[LATE] == inputs(5)[LATE]
    return run


async def test_it_is_of_the_pose_that_the_viewer_had_and_rendered_once(tmp_path: Path) -> None:
    run, renderer = kept_run(tmp_path / "run"), FakeRenderer()
    async with renderer.client() as client:
        assert await render_truth(run, client) is None
        assert await render_truth(run, client) is None
    assert len(renderer.asked) == 1
    assert decode(capture_path(run, 1, TRUTH).read_bytes())[0, 0, 1] == 20 * LATE
    assert not capture_path(run, 0, TRUTH).exists()


async def test_another_renderer_s_is_not_kept(tmp_path: Path) -> None:
    run = kept_run(tmp_path / "run")
    async with FakeRenderer(shade=90).client() as client:
        problem = await render_truth(run, client)
    assert problem is not None
    assert problem.startswith("Picture 1: the renderer answers differently now")
    assert not capture_path(run, 1, TRUTH).exists()


async def test_another_scene_is_not_even_asked(tmp_path: Path) -> None:
    run, renderer = kept_run(tmp_path / "run"), FakeRenderer()
    record = StoredRun(run).record.model_copy(update={"scene_sha256": "b" * 64})
    (run / "run.json").write_text(record.model_dump_json())
    async with renderer.client() as client:
        assert "has changed since the run" in (await render_truth(run, client) or "")
    assert renderer.asked == []


def test_what_they_say_is_a_figure_of_the_run(tmp_path: Path) -> None:
    run = kept_run(tmp_path / "run")
    seen = [Score(seq=number, picture="seen", digest="x", lpips=lpips) for number, lpips in enumerate((0.2, 0.4))]
    write_scores(run, [*seen, Score(seq=1, picture="original", digest="x", lpips=0.9)])
    figures = summarise(run).figures
    assert figures is not None
    assert figures.quality is not None
    assert figures.quality.seen_lpips == pytest.approx(0.3)
