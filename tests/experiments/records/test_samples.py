"""Samples: read back by number, and broken ones are reported in a sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from tests.experiments.made_up import sampled, write_run
from tests.not_files import NOT_FILES
from tigas_experiments.records.files import BrokenRecording
from tigas_experiments.records.samples import (
    ENHANCED,
    enhanced_path,
    read_sample_file,
    read_samples,
    sample_path,
    write_sample_file,
    write_samples,
)
from tigas_experiments.wire.recording import Sample


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    assert read_samples(run) == [], "as in a run without any"
    samples = [sampled(3), sampled(1_234_567, enhanced=True, restore="scene", enhance_ms=4.5)]
    for sample in samples:
        write_sample_file(run, sample.seq, "jpg", b"jpeg of %d" % sample.seq)
    write_sample_file(run, 1_234_567, ENHANCED[0], b"lossless")
    write_samples(run, samples)
    assert read_samples(run) == samples
    assert read_sample_file(sample_path(run, 3, "jpg")) == b"jpeg of 3"
    assert sample_path(run, 3, "jpg").name == "000003.jpg"
    assert enhanced_path(run, 3) is None
    path = enhanced_path(run, 1_234_567)
    assert path is not None
    assert read_sample_file(path) == b"lossless"


def test_samples_of_an_older_version_stay_readable(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    old = json.loads(sampled(3).model_dump_json())
    old["request"]["stamp"] = None
    (run / "samples.ndjson").write_text(json.dumps(old, separators=(",", ":")) + "\n")
    assert read_samples(run) == [sampled(3)]


def test_two_samples_of_one_number_are_refused(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    write_samples(run, [sampled(3), sampled(3)])
    with pytest.raises(BrokenRecording, match="two samples of one sequence number"):
        read_samples(run)


@pytest.mark.parametrize("kind", NOT_FILES)
def test_what_is_no_file_gets_a_sentence(tmp_path: Path, kind: str) -> None:
    run = write_run(tmp_path / "run")
    (run / "samples").mkdir()
    NOT_FILES[kind](run / "samples.ndjson")
    NOT_FILES[kind](sample_path(run, 3, "jpg"))
    with pytest.raises(BrokenRecording, match=r"samples.ndjson cannot be read: .+\."):
        read_samples(run)
    with pytest.raises(BrokenRecording, match=r"000003.jpg cannot be read: .+\."):
        read_sample_file(sample_path(run, 3, "jpg"))


@pytest.mark.parametrize("changes", [{"seq": 4}, {"request": {"format": "png"}}, {"width": 0}, {"bytes": -1}])
def test_samples_that_cannot_be_are_refused(changes: dict[str, object]) -> None:
    made = sampled(3).model_dump(exclude_none=True) | {"rung": 2}
    if isinstance(request := changes.get("request"), dict):
        changes = {"request": made["request"] | request}
    assert Sample.model_validate(made)
    with pytest.raises(ValidationError):
        Sample.model_validate(made | changes)
