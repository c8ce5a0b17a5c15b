"""One folder per run.

    run.json         the configuration, versions, machine, load, and whether the run is complete
    inputs.ndjson    poses sampled by the viewer          frames.ndjson   frames on screen
    replies.ndjson   received frames (if any)             requests.ndjson requested frames (if any)
    traffic.ndjson   bytes received by the page           load.ndjson     the machine's load
    link.ndjson      the shaper's record of its link
    captures/        shown pictures, as PNG               captures.ndjson their frames
    quality.ndjson   their comparison with ground truth
    snapshot.json    one of them, with the ideal picture in captures/view.png
    samples.ndjson   every n-th shown frame (if any)      samples/        their pictures (`samples.py`)

A run is complete if its run.json says so, which is written last: any earlier interruption leaves an incomplete
run.

The runs of an experiment are in one folder, as runs/<slug>, next to experiment.json with the plan.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, Field

from tigas_common.files import read_regular
from tigas_common.wire.model import WireModel
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records.files import BrokenRecording, read_lines, read_record, write_lines, write_record
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine, Server
from tigas_experiments.records.samples import MAX_PICTURE_BYTES, read_samples, write_sample_file, write_samples
from tigas_experiments.wire.recording import (
    Capture,
    Input,
    LinkSample,
    Recording,
    RecordingHead,
    Reply,
    Request,
    Sample,
    ShownFrame,
    Traffic,
)
from tigas_experiments.wire.run import Configuration
from tigas_experiments.wire.store import ExperimentName, Plan


class ExperimentRecord(WireModel):
    """experiment.json."""

    name: ExperimentName
    created: str
    """ISO 8601, UTC."""
    source: Literal["command", "page"]
    plan: Plan
    """As given."""
    planned: int | None = Field(default=None, ge=0)
    """How many runs it has when it is complete; unknown of early ones."""
    command: str | None = None
    """The command line, to repeat it; None for the page's and early experiments."""
    template: object = Field(default=None, exclude=True)
    """Of early experiments, which had two kinds of reports."""


def write_experiment(folder: Path, record: ExperimentRecord) -> None:
    """Make an experiment's folder, if missing, and write its plan. Raises OSError."""
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    write_record(folder / "experiment.json", record)


def read_experiment(folder: Path) -> ExperimentRecord:
    """Parse the output of write_experiment. Raises BrokenRecording."""
    return read_record(folder / "experiment.json", ExperimentRecord)


class Snapshot(WireModel):
    """One capture with its ground truth."""

    at: float
    capture: int


class InputDigests(WireModel):
    """SHA-256 of a run's input files, in hexadecimal digits; None for inputs other than files."""

    movement: str | None
    trace: str | None


class RunRecord(WireModel):
    """run.json."""

    status: Literal["running", "complete", "failed"]
    problem: str | None
    """Why it failed."""
    configuration: Configuration
    inputs_sha256: InputDigests | None = None
    """Unknown of runs that a page made, and of early ones."""
    machine: Machine
    started: str
    """ISO 8601, UTC."""
    server: Server | None = None
    """Unknown of runs that a page made, and of early ones."""
    browser: str | None = None
    backend: str | None = None
    """Implementation of the link's delay: netem or relay."""
    scene_bytes: int | None = None
    """Size of the scene's file, the download of a viewer that renders itself."""
    scene_sha256: str | None = None
    """Of the scene's file; None without one, and of early runs."""
    sampling_problem: str | None = None
    """Why there are fewer samples than were asked for."""
    points_sha256: str | None = None
    """Digest of the poses that the page was given: equal inputs have equal ones."""
    load: Load | None = None
    recording: RecordingHead | None = None


class StoredRun:
    """A run that was written, read back. Each property reads its file; they raise BrokenRecording."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.record = read_record(folder / "run.json", RunRecord)

    def inputs(self) -> list[Input]:
        """Poses that were sampled."""
        return read_lines(self.folder / "inputs.ndjson", Input)

    def frames(self) -> list[ShownFrame]:
        """Frames that were shown."""
        return read_lines(self.folder / "frames.ndjson", ShownFrame)

    def replies(self) -> list[Reply]:
        """Received frames; empty for DASH, and if not recorded."""
        path = self.folder / "replies.ndjson"
        return read_lines(path, Reply) if path.exists() else []

    def requests(self) -> list[Request]:
        """Requested frames; empty for DASH, and if not recorded."""
        path = self.folder / "requests.ndjson"
        return read_lines(path, Request) if path.exists() else []

    def traffic(self) -> list[Traffic]:
        """Received bytes over time."""
        return read_lines(self.folder / "traffic.ndjson", Traffic)

    def link(self) -> list[LinkSample]:
        """States of the link; empty for an unshaped run."""
        return read_lines(self.folder / "link.ndjson", LinkSample)

    def load(self) -> list[LoadSample]:
        """How busy the machine was."""
        return read_lines(self.folder / "load.ndjson", LoadSample)

    def quality(self) -> list[CaptureQuality]:
        """How the kept pictures compare with ground truth."""
        return read_lines(self.folder / "quality.ndjson", CaptureQuality)

    def captures(self) -> list[Capture]:
        """Times and frames of kept pictures; their files: `capture_path`."""
        return read_lines(self.folder / "captures.ndjson", Capture)

    def samples(self) -> list[Sample]:
        """Shown frames that were sampled; empty where none were. Their files: `samples.py`."""
        return read_samples(self.folder)

    def snapshot(self) -> tuple[float, bytes, bytes] | None:
        """Time (ms), the screen, and the viewer's ideal view, both as PNG; None without."""
        if not (self.folder / "snapshot.json").exists():
            return None
        snapshot = read_record(self.folder / "snapshot.json", Snapshot)
        shown, view = capture_path(self.folder, snapshot.capture), self.folder / "captures" / "view.png"
        try:
            return snapshot.at, read_regular(shown, MAX_PICTURE_BYTES), read_regular(view, MAX_PICTURE_BYTES)
        except OSError as error:
            raise BrokenRecording(f"{error.filename} cannot be read: {error.strerror}.") from None


class RunWriter:
    """Writes a run's folder. Raises OSError, such as when the disk is full."""

    def __init__(self, folder: Path, record: RunRecord) -> None:
        self.folder = folder
        self._record = record
        (folder / "captures").mkdir(parents=True)
        write_record(folder / "run.json", record)

    def recording(self, recording: Recording) -> None:
        """The page's record."""
        self._lines("inputs", recording.inputs)
        self._lines("frames", recording.frames)
        if recording.replies:
            self._lines("replies", recording.replies)
        if recording.requests:
            self._lines("requests", recording.requests)
        self._lines("traffic", recording.traffic)
        self._lines("captures", recording.captures)

    def link_and_load(self, link: Iterable[LinkSample], load: Sequence[LoadSample]) -> None:
        """How the link was meanwhile, and how busy the machine."""
        self._lines("link", link)
        self._lines("load", load)

    def capture(self, index: int, png: bytes) -> None:
        """One picture."""
        capture_path(self.folder, index).write_bytes(png)

    def snapshot(self, snapshot: Snapshot, view: bytes) -> None:
        """The viewer's ideal view at a capture's time."""
        (self.folder / "captures" / "view.png").write_bytes(view)
        (self.folder / "snapshot.json").write_text(snapshot.model_dump_json() + "\n", encoding="utf-8")

    def sample_picture(self, seq: int, kind: str, picture: bytes) -> None:
        """One of a sample's files, such as its `jpg`."""
        write_sample_file(self.folder, seq, kind, picture)

    def samples(self, samples: Iterable[Sample]) -> None:
        """Which there are, once all of their files are."""
        write_samples(self.folder, samples)

    def quality(self, entries: Iterable[CaptureQuality]) -> None:
        """How the pictures compare with ground truth."""
        self._lines("quality", entries)

    def close(self, **changes: object) -> RunRecord:
        """The last word: the record with changes."""
        self._record = self._record.model_copy(update=changes)
        write_record(self.folder / "run.json", self._record)
        return self._record

    def _lines(self, name: str, entries: Iterable[BaseModel]) -> None:
        write_lines(self.folder / f"{name}.ndjson", entries)


def capture_path(folder: Path, index: int, suffix: str = "png") -> Path:
    """A kept picture of a run, or an additional file of it."""
    return folder / "captures" / f"{index:04}.{suffix}"
