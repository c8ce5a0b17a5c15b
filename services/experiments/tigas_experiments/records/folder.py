"""One folder a run.

    run.json         the configuration, versions, machine, load, and whether the run is complete
    inputs.ndjson    poses that the viewer sampled        frames.ndjson   frames that were on the screen
    replies.ndjson   frames that came (if any did)        requests.ndjson frames that were asked for (if any were)
    traffic.ndjson   what the page received               load.ndjson     the machine's load
    link.ndjson      what the shaper told of its link
    captures/        pictures that were shown, as PNG     captures.ndjson which frames these are
    quality.ndjson   how they compare with ground truth
    snapshot.json    one of them, beside which captures/view.png shows what the viewer should have seen then
    samples.ndjson   every n-th shown frame (if any)      samples/        their pictures (`samples.py`)

A run is complete when its run.json says so, which is written last: whatever happens before leaves an incomplete run.

The runs of an experiment lie in one folder, as runs/<slug>, beside experiment.json, which says what was planned.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, Field

from tigas_common.files import read_regular
from tigas_common.wire.model import WireModel
from tigas_common.wire.recording import (
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
from tigas_common.wire.run import Configuration
from tigas_common.wire.store import ExperimentName, Plan
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records.lines import read_lines, read_record, write_lines, write_record
from tigas_experiments.records.load import Load, LoadSample
from tigas_experiments.records.machine import Machine, Server
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.samples import MAX_PICTURE_BYTES, read_samples, write_sample_file, write_samples

Template = Literal["experiment", "comparison"]
"""Which page tells of it: claims over groups of runs, or run by run."""


class ExperimentRecord(WireModel):
    """experiment.json."""

    name: ExperimentName
    created: str
    """ISO 8601, UTC."""
    source: Literal["command", "page"]
    plan: Plan
    """As it was given."""
    planned: int | None = Field(default=None, ge=0)
    """How many runs it has when it is complete; unknown of early ones."""
    template: Template = "experiment"
    """Of its report."""
    command: str | None = None
    """As it was typed, to run it again; None of what a page made, and of early ones."""


def write_experiment(folder: Path, record: ExperimentRecord) -> None:
    """Make an experiment's folder, if it is not there, and say in it what is planned. Raises OSError."""
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    write_record(folder / "experiment.json", record)


def read_experiment(folder: Path) -> ExperimentRecord:
    """What write_experiment wrote. Raises BrokenRecording."""
    return read_record(folder / "experiment.json", ExperimentRecord)


class Snapshot(WireModel):
    """One capture beside which ground truth was kept."""

    at: float
    capture: int


class InputDigests(WireModel):
    """SHA-256 of the files that a run was made from, in hexadecimal digits; None for what is no file."""

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
    """What made the link's delay: netem or relay."""
    scene_bytes: int | None = None
    """Of the scene's file: what a viewer that renders for itself would have to download."""
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
        """Frames that came; empty for DASH, and where nobody recorded them."""
        path = self.folder / "replies.ndjson"
        return read_lines(path, Reply) if path.exists() else []

    def requests(self) -> list[Request]:
        """Frames that were asked for; empty for DASH, and where nobody recorded them."""
        path = self.folder / "requests.ndjson"
        return read_lines(path, Request) if path.exists() else []

    def traffic(self) -> list[Traffic]:
        """What was received."""
        return read_lines(self.folder / "traffic.ndjson", Traffic)

    def link(self) -> list[LinkSample]:
        """What the link did; empty for an unshaped run."""
        return read_lines(self.folder / "link.ndjson", LinkSample)

    def load(self) -> list[LoadSample]:
        """How busy the machine was."""
        return read_lines(self.folder / "load.ndjson", LoadSample)

    def quality(self) -> list[CaptureQuality]:
        """How the kept pictures compare with ground truth."""
        return read_lines(self.folder / "quality.ndjson", CaptureQuality)

    def captures(self) -> list[Capture]:
        """When pictures were kept, and of what; their files: `capture_path`."""
        return read_lines(self.folder / "captures.ndjson", Capture)

    def samples(self) -> list[Sample]:
        """Shown frames that were sampled; empty where none were. Their files: `samples.py`."""
        return read_samples(self.folder)

    def snapshot(self) -> tuple[float, bytes, bytes] | None:
        """When (ms), what was on the screen, and the view that the viewer had then, both as PNG; None without."""
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
        """What the page recorded."""
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
        """Ground truth of what the viewer should have seen at a capture's time."""
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
    """A kept picture of a run, or what is beside it."""
    return folder / "captures" / f"{index:04}.{suffix}"
