"""Messages between the store and the page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, JsonValue, StringConstraints, model_validator

from tigas_common.wire.model import Entries, WireModel
from tigas_common.wire.shaper import Backend
from tigas_experiments.wire.movement import Anchor
from tigas_experiments.wire.recording import LinkSample, Recording, Sample
from tigas_experiments.wire.run import Configuration, RunPlan

AROUND_MS = 600_000
"""Maximum distance in time of records from a run's start and from its movement's end."""
MOST_KBPS = 1e9
MOST_BYTES = 10**15
MOST_SAMPLES = 10_000
"""Maximum number of samples in a run."""
MOST_FILE_CHARACTERS = 100_000
"""Maximum length of an experiment file."""
LATEST_UNIX_MS = 4e12
"""A time in the year 2096."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("a name is one line of text")
    return text


LONGEST_NAME = 100
ExperimentName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable)
]


def _finite(plan: dict[str, JsonValue]) -> dict[str, JsonValue]:
    try:
        json.dumps(plan, allow_nan=False)
    except ValueError:
        raise ValueError("its numbers must be finite") from None
    return plan


Plan = Annotated[dict[str, JsonValue], AfterValidator(_finite)]
"""A parsed experiment file."""
PageKey = Annotated[str, Field(pattern="^[A-Za-z0-9-]{1,64}$")]
"""Random key with which a page identifies itself."""


class ExperimentRequest(WireModel):
    """An experiment file (docs/experiments.md), and inputs that only the page has."""

    file: str = Field(max_length=MOST_FILE_CHARACTERS)
    """TOML or JSON."""
    movements: dict[str, str] = Field(default_factory=dict)
    """Movement traces as CSV, by file name."""
    traces_s: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    """Durations of the shaper's traces by name, required for experiments with segments."""


class PlanSummary(WireModel):
    """An expanded experiment file."""

    runs: int
    lasting: str
    """Approximate duration for people, such as `6 minutes`."""
    problem: str | None
    """Reason why the file cannot be expanded, in one sentence."""


class ExperimentCreated(WireModel):
    """Answer to an ExperimentRequest."""

    id: str


class NextRequest(WireModel):
    """A page's request for a run to perform."""

    page: PageKey
    begin: bool = False
    """Whether the page is starting over, so that failed runs are tried again."""
    allow_changes: bool = False
    """Resume even if the commit, ladder or a scene has changed."""


class RunJob(WireModel):
    """A run for the page to perform."""

    run: str
    """The run's folder."""
    title: str
    """Display name, such as `DASH tuned, 20mbit,20ms-rtt, stroll`."""
    configuration: Configuration
    settings: dict[str, JsonValue]
    """Settings of the viewer, including the seed; settings not listed have their defaults."""
    plan: RunPlan


class NextRun(WireModel):
    """The next run of an experiment, or a reason to wait or stop."""

    job: RunJob | None
    """Reserved for the page; null if all runs are complete, or if other pages are making the rest."""
    planned: int
    missing: int
    """Number of incomplete runs, including the job."""
    remaining_s: float
    """Approximate duration of the missing runs."""
    wait: bool
    """Whether to ask again later, as other pages are performing the remaining runs."""
    problem: str | None
    """Reason why the experiment ended before its last run."""


class RunUpload(WireModel):
    """A performed run. Metrics can be computed from any valid one."""

    problem: str | None = Field(default=None, min_length=1, max_length=1000)
    """Reason for a failure."""
    recording: Recording | None = None
    """null only for a failed run."""
    link: Entries[LinkSample] = ()
    """The shaper's record of its link; empty without a shaper."""
    backend: Backend | None = None
    """Implementation of the link's delay; null without a shaper."""
    sampling_problem: str | None = Field(default=None, min_length=1, max_length=1000)
    """Reason why there are fewer samples than requested."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for problem in self._problems():
            raise ValueError(problem)
        return self

    def _problems(self) -> Iterator[str]:
        recording, link = self.recording, self.link
        if recording is None:
            if self.problem is None:
                yield "a run has a recording or a problem"
            return
        if not 0 <= recording.started_unix_ms <= LATEST_UNIX_MS:
            yield "the recording's start time is impossible"
        if recording.traffic and max(entry.bytes for entry in recording.traffic) > MOST_BYTES:
            yield "the number of bytes is impossible"
        if any(later.at < earlier.at or later.drops < earlier.drops for earlier, later in pairwise(link)):
            yield "the times and the drops of link must not go back"
        rates = (rate for at in link for rate in (at.target_kbps, at.delivered_kbps, at.up_delivered_kbps))
        if not all(0 <= rate <= MOST_KBPS for rate in rates):
            yield f"the rates of link must be 0 to {MOST_KBPS:g} kbit/s"
        last = recording.duration_ms + AROUND_MS
        lists = (recording.inputs, recording.frames, recording.replies, recording.requests, recording.traffic, link)
        for entries in lists:  # ordered by time
            if entries and not -AROUND_MS <= entries[0].at <= entries[-1].at <= last:
                yield "the recording has times long before or long after the run"
        if recording.ended_ms > last:
            yield "the recording ended long after the run"


def mismatch(configuration: Configuration, recording: Recording) -> str | None:
    """Reason why a recording cannot be of a run, in one sentence; None if it can."""
    if recording.scene != configuration.scene:
        return f"The recording is of the scene {recording.scene!r}, not of {configuration.scene!r}."
    if recording.mode != configuration.mode.partition("-")[0]:
        return f"The recording is of the mode {recording.mode}, not of {configuration.mode}."
    if abs(recording.duration_ms - configuration.duration_s * 1000) > 1:
        return f"The recording lasts {recording.duration_ms:g} ms, not {configuration.duration_s:g} s."
    return None


class SampleCounts(WireModel):
    """Summary of a run's samples."""

    samples: int
    identical: int
    """Number of frames that were rendered identically, byte for byte."""
    different: int
    """Number of differing frames: ground truth may come from another renderer than the frames."""
    missing: int
    """Number of incomplete samples."""


class SampleIndex(WireModel):
    """All samples of a run, sent after their pictures."""

    samples: Annotated[tuple[Sample, ...], Field(min_length=1, max_length=MOST_SAMPLES, fail_fast=True)]


class UploadedFile(WireModel):
    """A picture of a sample."""

    name: str
    bytes: int


class UploadedSamples(WireModel):
    """The samples of a run that the store already has: a resumed upload sends only the others."""

    complete: bool
    """Whether their index is stored as well."""
    files: Entries[UploadedFile]


class RunRow(WireModel):
    """One run of an experiment."""

    folder: str
    status: Literal["running", "complete", "failed"]
    """The status of a killed run stays `running`."""
    problem: str | None
    """Reason why there are no metrics."""
    configuration: Configuration
    samples: SampleCounts | None
    """null for a run without samples."""
    saturated_share: float | None = None
    """Share of the run in which processors or the render service were saturated, if large enough to affect latencies;
    null otherwise, and if unknown.
    """


class ExperimentSummary(WireModel):
    """One experiment in the list."""

    id: str
    name: str
    created: str
    """ISO 8601, UTC."""
    source: Literal["command", "page"]
    planned: int | None = None
    """Number of runs in the complete experiment; null if unknown."""
    runs: int
    """Number of runs made, with any status."""
    complete: int
    """Number of these that are complete."""
    sampled: int
    """Number of these that have samples."""


class ExperimentList(WireModel):
    """All experiments, newest first."""

    experiments: Entries[ExperimentSummary]


class Experiment(WireModel):
    """One experiment and its runs."""

    id: str
    name: str
    created: str
    source: Literal["command", "page"]
    plan: Plan
    """The plan as given."""
    complete: int
    runs: Entries[RunRow]


class SampleRow(WireModel):
    """One sample of a run. Pictures are file names (`/experiments/{id}/runs/{run}/samples/{name}`), or null."""

    seq: int
    at: float
    """Time at which it was on screen, in ms on the run's clock."""
    rung: int | None
    bytes: int
    width: int
    height: int
    """Size of the shown picture in pixels."""
    restore: str
    upscale: str
    enhance_ms: float | None
    original: str | None
    """The received frame."""
    enhanced: str | None
    """The shown picture."""
    truth: str | None
    """The same view, lossless."""
    replayed: str | None
    """A later answer to the same request, if it differs."""
    identical: bool | None
    """Whether the later answer was identical; null if unknown."""
    problem: str | None
    """Reason why something is missing."""


class SampleList(WireModel):
    """The samples of a run, ordered by time."""

    samples: Entries[SampleRow]
    problem: str | None
    """Reason why they cannot be read, if so."""


class Materialisation(WireModel):
    """Progress of rendering an experiment's samples again."""

    state: Literal["idle", "running"]
    done: int
    total: int
    """Number of samples."""
    problem: str | None
    """The last problem."""


class Movement(WireModel):
    """A movement trace."""

    name: str
    duration_ms: float = Field(ge=0)
    anchor: Anchor
    description: str


class MovementList(WireModel):
    """All movement traces, by name."""

    movements: Entries[Movement]
