"""The folder of a run:

    run.json         the configuration, versions, machine, load, and whether the run is complete
    inputs.ndjson    poses sampled by the viewer          frames.ndjson   frames on screen
    replies.ndjson   received frames (if any)             requests.ndjson requested frames (if any)
    traffic.ndjson   bytes received by the page           load.ndjson     the machine's load
    link.ndjson      the shaper's record of its link
    captures/        captured screens, as PNG             captures.ndjson their frames
    quality.ndjson   their comparison with ground truth
    snapshot.json    one of them, with the ideal picture in captures/view.png
    samples.ndjson   every n-th shown frame (if any)      samples/        their pictures (`samples.py`)

A run is complete if run.json, which is written last, says so: an earlier interruption leaves an incomplete run.

The runs of an experiment are in one folder, as runs/<slug>, next to experiment.json with the plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, Self

from pydantic import BaseModel, Field

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records.files import Entry, read_lines, read_record, write_lines, write_record
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine, Server
from tigas_experiments.records.samples import read_sample_file
from tigas_experiments.wire.recording import (
    Capture,
    Input,
    LinkSample,
    Recording,
    RecordingHead,
    Reply,
    Request,
    ShownFrame,
    Traffic,
)
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import ExperimentName, Plan


class ExperimentRecord(WireModel):
    name: ExperimentName
    created: str
    """ISO 8601, UTC."""
    source: Literal["command", "page"]
    plan: Plan
    """The plan as given."""
    planned: int | None = Field(default=None, ge=0)
    """Number of runs of the complete experiment; unknown for early ones."""
    command: str | None = None
    """Command line that resumes the experiment; None for experiments made on the page, and for early ones."""
    traces_s: dict[str, float] = Field(default_factory=dict)
    """Durations of the shaper's traces, if segments need them."""
    template: object = Field(default=None, exclude=True)
    """Ignored field of early experiments."""


def write_experiment(folder: Path, record: ExperimentRecord) -> None:
    """Create an experiment's folder if missing, and write its plan. Raises OSError."""
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    write_record(folder / "experiment.json", record)


def experiment_folder(folder: Path) -> Path:
    """The folder of the experiment to which a run's folder belongs; any other folder itself."""
    whole = folder.resolve()
    return whole.parents[1] if whole.parent.name == "runs" and (whole / "run.json").exists() else whole


def read_experiment(folder: Path) -> ExperimentRecord:
    """Read an experiment's record. Raises BrokenRecording."""
    return read_record(folder / "experiment.json", ExperimentRecord)


class Snapshot(WireModel):
    """One capture with its ground truth."""

    at: float
    capture: int


class InputDigests(WireModel):
    """SHA-256 of a run's input files in hexadecimal; None for inputs that are not files."""

    movement: str | None
    trace: str | None


class RunRecord(WireModel):
    """The content of run.json. Digests and server are unknown for runs made by a page, and for early runs."""

    status: Literal["running", "complete", "failed"] = "running"
    problem: str | None = None
    """Reason for a failure."""
    configuration: Configuration
    inputs_sha256: InputDigests | None = None
    machine: Machine
    started: str
    """ISO 8601, UTC."""
    server: Server | None = None
    browser: str | None = None
    backend: str | None = None
    """Implementation of the link's delay: netem or relay."""
    scene_bytes: int | None = None
    """Size of the scene's file, which a viewer that renders locally downloads."""
    scene_sha256: str | None = None
    """Digest of the scene's file; None if there is no file, and for early runs."""
    sampling_problem: str | None = None
    """Reason why there are fewer samples than requested."""
    points_sha256: str | None = None
    """Digest of the poses given to the page: equal for equal inputs."""
    load: Load | None = None
    recording: RecordingHead | None = None


FILES: Mapping[type[BaseModel], str] = {
    Input: "inputs",
    ShownFrame: "frames",
    Reply: "replies",
    Request: "requests",
    Traffic: "traffic",
    LinkSample: "link",
    LoadSample: "load",
    CaptureQuality: "quality",
    Capture: "captures",
}
"""Names of the NDJSON files, by type of entry."""
LADDER = "ladder.jpg"
"""One view of the experiment at each rung, made by `tigas quality ladder`."""
OPTIONAL = (Reply, Request)
"""Types of entries without a file if a run recorded none."""


class StoredRun:
    """A run's folder. Methods raise BrokenRecording."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.record = read_record(folder / "run.json", RunRecord)

    def read(self, model: type[Entry]) -> list[Entry]:
        path = _lines(self.folder, model)
        return [] if model in OPTIONAL and not path.exists() else read_lines(path, model)


def read_snapshot(folder: Path) -> tuple[float, bytes, bytes] | None:
    """Time (ms) and PNGs of the screen and the ideal view; None without a snapshot. Raises BrokenRecording."""
    if not (folder / "snapshot.json").exists():
        return None
    snapshot = read_record(folder / "snapshot.json", Snapshot)
    shown, view = capture_path(folder, snapshot.capture), folder / "captures" / "view.png"
    return snapshot.at, read_sample_file(shown), read_sample_file(view)


class RunWriter:
    """Writes a run's folder. Raises OSError, such as when the disk is full."""

    def __init__(self, folder: Path, record: RunRecord) -> None:
        self.folder = folder
        self._record = record
        (folder / "captures").mkdir(parents=True)
        write_record(folder / "run.json", record)

    @classmethod
    def resume(cls, run: StoredRun) -> Self:
        writer = cls.__new__(cls)
        writer.folder, writer._record = run.folder, run.record
        return writer

    @property
    def configuration(self) -> Configuration:
        return self._record.configuration

    def recording(self, recording: Recording) -> None:
        """Write the page's records, with lists of received and requested frames only if there are any."""
        self.write(Input, recording.inputs)
        self.write(ShownFrame, recording.frames)
        if recording.replies:
            self.write(Reply, recording.replies)
        if recording.requests:
            self.write(Request, recording.requests)
        self.write(Traffic, recording.traffic)
        self.write(Capture, recording.captures)

    def write(self, model: type[Entry], entries: Iterable[Entry]) -> None:
        write_lines(_lines(self.folder, model), entries)

    def capture(self, index: int, png: bytes) -> None:
        capture_path(self.folder, index).write_bytes(png)

    def snapshot(self, snapshot: Snapshot, view: bytes) -> None:
        (self.folder / "captures" / "view.png").write_bytes(view)
        (self.folder / "snapshot.json").write_text(snapshot.model_dump_json() + "\n", encoding="utf-8")

    def close(self, **changes: object) -> RunRecord:
        """Write the final record, with these changes."""
        self._record = self._record.model_copy(update=changes)
        write_record(self.folder / "run.json", self._record)
        return self._record


def capture_path(folder: Path, index: int, suffix: str = "png") -> Path:
    """Path of a run's capture, or of a file that belongs to it."""
    return folder / "captures" / f"{index:04}.{suffix}"


def _lines(folder: Path, model: type[BaseModel]) -> Path:
    return folder / f"{FILES[model]}.ndjson"
