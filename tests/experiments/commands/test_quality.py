"""`tigas quality` as a person uses it: of a run, of an experiment, of pictures alone, and of rendered frames."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from filelock import FileLock
from PIL import Image

from tests.command import Result, tigas
from tests.experiments.report.synthetic_results import rows as csv_rows
from tests.experiments.report.synthetic_results import write_run
from tests.experiments.triplets_made_up import write_triplets
from tests.web.scenes import SMALL, write_scenes
from tests.web.server import RenderServer
from tigas_common.wire.render import RenderRequest
from tigas_experiments.quality.picture import CaptureQuality, compare, decode, encode
from tigas_experiments.records.files import write_lines, write_record
from tigas_experiments.records.folder import StoredRun, capture_path
from tigas_experiments.records.samples import (
    TRUTH,
    Rerendered,
    append_rerendered,
    rerender_log,
    write_sample_file,
)
from tigas_experiments.records.scores import SCORES, read_scores
from tigas_experiments.report.report import write_report
from tigas_experiments.wire.recording import Capture, Input, Lens


def quality(*arguments: str) -> Result:
    """The command as a person types it."""
    return tigas("quality", *arguments, columns=300)


def words(result: Result) -> str:
    return re.sub(r"[\s│┃━┏┓┗┛┡┩└┘├┤─┼┴┬╇]+", " ", result.output)


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Two controllers; one has samples of two runs."""
    for repeat in (0, 1):
        run = write_run(tmp_path / "runs" / f"latency-{repeat}", "latency", "bus", 20.0, repeat=repeat)
        write_triplets(run, 2, quality=40 - 10 * repeat)
    write_run(tmp_path / "runs" / "seen", "seen", "bus", 20.0)
    return tmp_path


def test_an_experiment_is_scored_by_controller_network_and_model(experiment: Path) -> None:
    result = quality(str(experiment), "--metrics", "psnr,ssim,vif")
    assert result.exit_code == 0, result.output
    rows = words(result)
    assert re.search(r"bus, 20 ms, Latency, original 4 [\d.]+ 0\.[\d]+ 0\.[\d]+ .*± [\d.]+ ± 0\.[\d]+ ±", rows)
    assert re.search(r"bus, 20 ms, Latency, enhanced, scene 4 ", rows)
    assert re.search(r"bus, 20 ms, Latency, difference, scene 4 \+[\d.]+ ", rows)
    assert "Seen" not in rows
    assert len(read_scores(experiment / "runs" / "latency-1")) == 4


def test_a_run_that_failed_is_not_in_the_table(experiment: Path) -> None:
    failed = experiment / "runs" / "latency-1"
    write_record(failed / "run.json", StoredRun(failed).record.model_copy(update={"status": "failed"}))
    result = quality(str(experiment), "--metrics", "psnr")
    assert re.search(r"Latency, original 2 [\d.]+", words(result)), result.output
    assert "One run is not complete" in words(result)


def test_a_folder_with_pictures_alone_is_scored_too(tmp_path: Path) -> None:
    write_triplets(tmp_path, 2, enhance=None)
    (tmp_path / "samples.ndjson").unlink()
    result = quality(str(tmp_path), "--metrics", "psnr")
    assert result.exit_code == 0, result.output
    assert re.search(r"original 2 [\d.]+ ± [\d.]+ $", words(result))


def test_one_run_of_an_experiment(experiment: Path) -> None:
    assert quality(str(experiment / "runs" / "latency-0"), "--metrics", "ssim").exit_code == 0
    assert not (experiment / "runs" / "latency-1" / SCORES).exists()


def test_without_weights_only_these_two_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_triplets(tmp_path, 1, enhance=None)
    result = quality(str(tmp_path))
    assert result.exit_code == 0
    assert "LPIPS is left out, because its weights are missing: tigas quality fetch" in words(result)
    assert "DISTS is left out" in words(result)
    assert set(read_scores(tmp_path)[0].values) == {"psnr", "ssim", "vmaf", "vif"}
    alone = quality(str(tmp_path), "--metrics", "dists")
    assert alone.exit_code == 1
    assert "DISTS is left out, because its weights are missing: tigas quality fetch" in words(alone)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--metrics", "psnr,beauty"], "'beauty' is not a metric; choose from psnr, ssim, vmaf, vif, lpips, dists."),
        (["--metrics", " , "], "--metrics is empty"),
        (["--metrics", "psnr"], "has no samples or captures with ground truth (docs/experiments.md)."),
    ],
)
def test_what_cannot_be_done_is_a_sentence(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    write_run(tmp_path / "runs" / "a")
    result = quality(str(tmp_path), *arguments)
    assert result.exit_code == 1
    assert sentence in words(result)


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    result = quality(str(tmp_path / "missing"))
    assert result.exit_code == 1
    assert "cannot be read" in words(result)


def test_broken_scores_are_named_and_the_other_runs_go_on(experiment: Path) -> None:
    (experiment / "runs" / "latency-0" / SCORES).write_text("rubbish\n")
    result = quality(str(experiment), "--metrics", "psnr")
    assert result.exit_code == 0
    assert re.search(r"latency-0: .*scores\.ndjson, line 1", words(result))
    assert "Latency, original 2 " in words(result)


def test_a_folder_in_which_runs_are_made_is_left_alone(experiment: Path) -> None:
    with FileLock(experiment / ".lock"):
        for folder in (experiment, experiment / "runs" / "latency-0"):
            result = quality(str(folder), "--metrics", "psnr")
            assert result.exit_code == 1
            assert "are being made or scored; try again later" in words(result)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a render service with a small scene."""
    models = tmp_path_factory.mktemp("models")
    write_scenes(models)
    with RenderServer("--scenes", str(models)) as server:
        yield server.url.rstrip("/")


def test_what_was_seen_is_scored_after_its_ground_truth_was_rendered(rendered: str, tmp_path: Path) -> None:
    run = write_run(tmp_path / "runs" / "a", "seen", "bus", 20.0, scene=SMALL)
    stored = StoredRun(run)
    pose = stored.read(Input)[20].model_copy(update={"position": (0.0, 0.0, 0.0)})
    write_lines(run / "inputs.ndjson", [pose])
    head = stored.record.recording
    assert head is not None
    lens = Lens(width=96, height=54, fx=60, fy=60, cx=48, cy=27)
    record = stored.record.model_copy(update={"recording": head.model_copy(update={"scene": SMALL, "lens": lens})})
    (run / "run.json").write_text(record.model_dump_json())
    asked = RenderRequest.at(SMALL, pose.camera, lens.intrinsics, format="png")
    truth = httpx.post(f"{rendered}/render", content=asked.model_dump_json(exclude_none=True), timeout=90).content
    shown = decode(truth) // 2
    write_lines(run / "captures.ndjson", [Capture(at=pose.at, shown_at=0, pose=3, rung=2, width=96, height=54)])
    capture_path(run, 0).write_bytes(encode(shown))
    seen = compare(shown, decode(truth))
    write_lines(
        run / "quality.ndjson", [CaptureQuality(at=pose.at, pose=3, rung=2, picture=None, view=None, seen=seen)]
    )
    result = quality(str(tmp_path), "--metrics", "psnr,ssim", "--render", rendered)
    assert result.exit_code == 0, result.output
    assert re.search(r"bus, 20 ms, Seen, seen 1 ", words(result))
    assert read_scores(run)[0].psnr == pytest.approx(seen.psnr_db)


@pytest.mark.slow
def test_the_ladder_is_shown_as_one_view_with_its_sizes(rendered: str, experiment: Path) -> None:
    for run in (experiment / "runs").iterdir():
        record = run / "run.json"
        record.write_text(record.read_text().replace('"courtyard"', f'"{SMALL}"'))
        amid_pebbles = StoredRun(run).read(Input)[0].model_copy(update={"position": (0.0, 0.0, 0.0)})
        of_nothing = amid_pebbles.model_copy(update={"position": (0.0, 0.0, 1e4)})
        write_lines(run / "inputs.ndjson", [amid_pebbles, of_nothing])
    result = quality("ladder", str(experiment), "--render", rendered)
    assert result.exit_code == 0, result.output
    found = csv_rows(experiment / "ladder.csv")
    assert [(row["name"], row["width"], row["jpeg_quality"]) for row in found] == [
        ("High", "1280", "90"),
        ("Medium-High", "960", "65"),
        ("Medium-Low", "640", "35"),
        ("Low", "320", "10"),
    ]
    for column in ("bytes", "psnr_db", "ssim"):
        values = [float(row[column]) for row in found]
        assert values == sorted(values, reverse=True)
        assert len(set(values)) == 4
    with Image.open(experiment / "ladder.jpg") as picture:
        assert picture.width > 3 * picture.height / 2
    assert "data:image/jpeg;base64" in write_report(experiment, experiment).page.read_text()


def test_without_a_render_service_there_is_no_ladder(experiment: Path) -> None:
    result = quality("ladder", str(experiment), "--render", "http://127.0.0.1:1")
    assert result.exit_code == 1
    assert "The render service at http://127.0.0.1:1 does not answer" in words(result)
    assert not (experiment / "ladder.csv").exists()


def test_frames_that_the_renderer_would_not_send_again_are_told_of(experiment: Path) -> None:
    run = experiment / "runs" / "latency-0"
    with rerender_log(run) as file:
        append_rerendered(file, Rerendered(seq=10, identical=False, problem=None, psnr_db=20.0))
    said = words(quality(str(run), "--metrics", "psnr"))
    assert "latency-0: on rendering again, 1 of 2 samples differed, so their ground truth may not match" in said


def test_nothing_that_can_be_compared_is_a_failure(tmp_path: Path) -> None:
    write_triplets(tmp_path, 1)
    write_sample_file(tmp_path, 10, TRUTH, b"no picture")
    result = quality(str(tmp_path), "--metrics", "psnr")
    assert result.exit_code == 1
    assert "sample 10: A picture cannot be read" in words(result)
