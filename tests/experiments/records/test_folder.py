"""A run's folder and its samples: written, read, and refused if broken."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from pydantic import JsonValue, ValidationError

from tests.experiments.made_up import recording, reply, sampled, write_run
from tests.not_files import NOT_FILES
from tigas_experiments.quality.picture import CaptureQuality, Quality
from tigas_experiments.records.files import BrokenRecording, parse_recording
from tigas_experiments.records.folder import (
    ExperimentRecord,
    RunWriter,
    StoredRun,
    experiment_folder,
    read_experiment,
    read_snapshot,
    write_experiment,
)
from tigas_experiments.records.samples import (
    ENHANCED,
    enhanced_path,
    read_sample_file,
    read_samples,
    sample_path,
    write_sample_file,
    write_samples,
)
from tigas_experiments.records.statistics import IN_TIME
from tigas_experiments.records.summary import summarise
from tigas_experiments.wire.recording import Input, Reply, Sample, ShownFrame, Traffic


def test_a_run_belongs_to_the_experiment_two_folders_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, alone = write_run(tmp_path / "it" / "runs" / "a"), write_run(tmp_path / "alone")
    assert [experiment_folder(each) for each in (run, alone, tmp_path / "it")] == [
        tmp_path / "it",
        alone,
        tmp_path / "it",
    ]
    monkeypatch.chdir(run)
    assert experiment_folder(Path()) == tmp_path / "it"


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    stored = StoredRun(write_run(tmp_path / "run"))
    assert stored.record.status == "complete"
    assert [entry.pose for entry in stored.read(Input)] == list(range(1, 51))
    assert [frame.at for frame in stored.read(ShownFrame)][:2] == [40, 60]
    assert stored.read(CaptureQuality)[0].view == Quality(psnr_db=20.0, ssim=0.6)
    assert stored.read(CaptureQuality)[0].seen == Quality(psnr_db=18.0, ssim=0.5)
    figures = summarise(tmp_path / "run").figures
    assert figures is not None
    assert (figures.values["motion_to_photon_p50_ms"], figures.values[IN_TIME]) == (40, 100)
    rates = ("received_mbit_s", "over_link_mbit_s", "link_mbit_s")
    assert [figures.values[name] for name in rates] == [1, 5, 20]
    assert figures.values["trace_began_s"] == 0.012


def test_replies_come_back_and_may_be_missing(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run")
    assert StoredRun(folder).read(Reply) == []
    entry = reply(20, 35, pose=7).model_dump(mode="json")
    made = parse_recording(json.dumps(recording(replies=[entry])))
    RunWriter(tmp_path / "other", StoredRun(folder).record).recording(made)
    (stored,) = StoredRun(tmp_path / "other").read(Reply)
    assert stored.model_dump(mode="json") == entry
    assert stored.time_ms == 35


@pytest.mark.parametrize("kind", NOT_FILES)
@pytest.mark.parametrize("name", ["run.json", "frames.ndjson", "snapshot.json", "captures/view.png"])
def test_what_is_no_file_in_a_folder_makes_it_broken(tmp_path: Path, name: str, kind: str) -> None:
    folder = write_run(tmp_path / "run")
    (folder / name).unlink()
    NOT_FILES[kind](folder / name)
    with pytest.raises(BrokenRecording, match=r"cannot be read: .+\."):
        _read_all(folder)


def test_a_line_without_end_is_refused(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run")
    (folder / "traffic.ndjson").write_text("{" + '"a":0,' * 1_000_000)
    with pytest.raises(BrokenRecording, match=r"traffic.ndjson, line 1 is longer than 1,000,000 characters\."):
        _read_all(folder)


def _read_all(folder: Path) -> None:
    stored = StoredRun(folder)
    stored.read(ShownFrame)
    stored.read(Traffic)
    read_snapshot(folder)


@pytest.mark.parametrize(
    "changes",
    [
        {"asked_at": 60},
        {"first_byte_at": 19},
        {"at": 700_000, "first_byte_at": 30},
        {"bytes": -1},
        {"throughput_kbps": -1},
        {"pose": None},
    ],
)
def test_replies_that_cannot_be_are_refused(changes: dict[str, object]) -> None:
    entry = reply(20, 35).model_dump(mode="json")
    with pytest.raises(BrokenRecording, match=r"replies\.0"):
        parse_recording(json.dumps(recording(replies=[entry | changes])))


@pytest.mark.parametrize("length", [0, 1, 30, -2])
def test_a_file_that_breaks_off_costs_its_run_alone(tmp_path: Path, length: int) -> None:
    path = write_run(tmp_path / "run") / "frames.ndjson"
    whole = path.read_text()
    path.write_text(whole[:length])
    summary = summarise(tmp_path / "run")
    if length == 0:  # no frame was ever shown
        assert summary.figures
        assert summary.figures.values["motion_to_photon_p50_ms"] == math.inf
        return
    assert summary.figures is None
    assert summary.problem is not None
    assert "frames.ndjson, line " in summary.problem


@pytest.mark.parametrize("name", ["inputs.ndjson", "frames.ndjson", "link.ndjson", "quality.ndjson", "traffic.ndjson"])
@pytest.mark.parametrize("content", [b"\xff\xfe", b"[1]\n", b'{"at": NaN}\n', b'{"at": 1e999}\n', None])
def test_a_hostile_file_gets_a_sentence(tmp_path: Path, name: str, content: bytes | None) -> None:
    path = write_run(tmp_path / "run") / name
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    problem = summarise(tmp_path / "run").problem
    assert problem is not None
    assert name in problem


@pytest.mark.parametrize("content", ["", "{", '{"status": "complete"}', "[]"])
def test_a_broken_record_is_no_run(tmp_path: Path, content: str) -> None:
    (write_run(tmp_path / "run") / "run.json").write_text(content)
    with pytest.raises(BrokenRecording, match=r"run\.json is broken"):
        StoredRun(tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"inputs": [{"at": 0, "pose": 2, "position": [0, 0], "quaternion": [0, 0, 0, 1]}]}, "inputs.0.position"),
        ({"frames": [{"at": float("nan")}]}, "frames.0"),
        ({"mode": "magic"}, "mode"),
        ({"duration_ms": -1}, "duration_ms"),
        ({"surprise": 1}, "surprise"),
    ],
)
def test_what_a_page_must_not_say(changes: dict[str, object], sentence: str) -> None:
    with pytest.raises(BrokenRecording, match=sentence):
        parse_recording(json.dumps(recording(**changes)))


def test_poses_and_times_must_grow() -> None:
    made = recording()
    backwards = [made["inputs"][1], made["inputs"][0]]
    with pytest.raises(BrokenRecording, match="must increase"):
        parse_recording(json.dumps(made | {"inputs": backwards}))
    frames = [made["frames"][1], made["frames"][0]]
    with pytest.raises(BrokenRecording, match="times of frames"):
        parse_recording(json.dumps(made | {"frames": frames}))


def test_an_experiment_says_what_was_planned(tmp_path: Path) -> None:
    plan: dict[str, JsonValue] = {"modes": ["stateless"], "rtts_ms": [20, 50.5], "seed": None}
    record = ExperimentRecord(
        name="Größe & <b>", created="2026-01-01T00:00:00+00:00", source="page", plan=plan, planned=12
    )
    write_experiment(tmp_path / "made", record)
    assert read_experiment(tmp_path / "made") == record
    write_experiment(tmp_path / "made", record)  # a resumed experiment says it again
    path = tmp_path / "made" / "experiment.json"
    path.write_text(path.read_text().replace("{", '{"template": "comparison",', 1))
    assert read_experiment(tmp_path / "made").name == record.name, "early ones said which page their report has"
    assert sorted(path.name for path in (tmp_path / "made").iterdir()) == ["experiment.json", "runs"]


@pytest.mark.parametrize(
    "changes",
    [
        {"name": " "},
        {"name": "a\nb"},
        {"name": "x" * 101},
        {"source": "cat"},
        {"plan": [1]},
        {"more": 1},
        {"planned": -1},
        {"plan": {"a": [math.nan]}},
    ],
)
def test_a_broken_experiment_gets_a_sentence(tmp_path: Path, changes: dict[str, object]) -> None:
    record = {"name": "a", "created": "2026-01-01T00:00:00+00:00", "source": "page", "plan": {}}
    (tmp_path / "experiment.json").write_text(json.dumps(record))
    assert read_experiment(tmp_path).planned is None, "as early ones are"
    (tmp_path / "experiment.json").write_text(json.dumps(record | changes))
    with pytest.raises(BrokenRecording, match=r"experiment\.json is broken"):
        read_experiment(tmp_path)


def test_written_samples_come_back(tmp_path: Path) -> None:
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
    with pytest.raises(BrokenRecording, match="two samples with the same sequence number"):
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
