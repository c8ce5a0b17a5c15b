"""`tigas experiment rerender` as a person uses it, against a real render service."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tests.experiments.processes import finished, started
from tests.experiments.samples.real_frames import NUMBERS, sample_run
from tests.web.scenes import write_scenes
from tests.web.server import RenderServer
from tigas_experiments.quality.picture import decode
from tigas_experiments.records.samples import JPEG, REPLAYED, RERENDERED, TRUTH, sample_path, write_sample_file


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("models")
    write_scenes(made)
    return made


@pytest.fixture(scope="module")
def server(models: Path) -> Iterator[RenderServer]:
    with RenderServer("--scenes", str(models)) as running:
        yield running


@pytest.mark.slow
def test_the_same_service_sends_every_frame_again_and_another_is_flagged(server: RenderServer, tmp_path: Path) -> None:
    run = sample_run(server, tmp_path / "runs" / "one")
    write_run(tmp_path / "runs" / "old")
    command = ("experiment", "rerender", str(tmp_path), "--render", server.url)
    status, output, errors = finished(started(*command))
    assert status == 0, errors
    assert output.split("\n")[3].replace("│", " ").split() == ["one", "3", "3", "0", "0"]
    for seq in NUMBERS:
        assert decode(sample_path(run, seq, TRUTH).read_bytes()).shape == (36, 64, 3)

    write_sample_file(run, 3, JPEG, sample_path(run, 8, JPEG).read_bytes())
    (run / RERENDERED).unlink()
    status, output, errors = finished(started(*command))
    assert status == 0, errors
    assert output.split("\n")[3].replace("│", " ").split() == ["one", "3", "2", "1", "0"]
    assert "The render service answers differently now" in output
    assert sample_path(run, 3, REPLAYED).is_file()


@pytest.mark.slow
def test_scoring_renders_what_is_missing_first(server: RenderServer, tmp_path: Path) -> None:
    run = sample_run(server, tmp_path / "runs" / "one")
    command = ("quality", str(run), "--metrics", "psnr")
    status, _, errors = finished(started(*command))
    assert (status, "no samples or captures with ground truth" in " ".join(errors.split())) == (1, True)
    status, output, errors = finished(started(*command, "--render", server.url))
    assert status == 0, errors
    assert "original" in output
    assert len(list((run / "samples").glob("*.truth.png"))) == 3


@pytest.mark.slow
def test_without_a_service_one_is_started(
    server: RenderServer, models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample_run(server, tmp_path / "runs" / "one")
    monkeypatch.setenv("TIGAS_RENDER_SCENES", str(models))
    status, output, errors = finished(started("experiment", "rerender", str(tmp_path)))
    assert status == 0, errors
    assert output.split("\n")[3].replace("│", " ").split() == ["one", "3", "3", "0", "0"]
