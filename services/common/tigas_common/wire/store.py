"""What travels between the store and the page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, JsonValue, StringConstraints, model_validator

from tigas_common.wire.figures import Figures
from tigas_common.wire.model import Entries, WireModel
from tigas_common.wire.recording import LinkSample, Recording, Sample
from tigas_common.wire.run import Configuration
from tigas_common.wire.shaper import Backend

AROUND_MS = 600_000
"""What is recorded lies at most so long before a run's start or after its movement's end."""
MOST_KBPS = 1e9
MOST_BYTES = 10**15
MOST_SAMPLES = 10_000
"""Of a run."""
LATEST_UNIX_MS = 4e12
"""In the year 2096."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("a name is one line of text")
    return text


ExperimentName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=100), AfterValidator(_printable)
]


def _finite(plan: dict[str, JsonValue]) -> dict[str, JsonValue]:
    try:
        json.dumps(plan, allow_nan=False)
    except ValueError:
        raise ValueError("its numbers must be finite") from None
    return plan


Plan = Annotated[dict[str, JsonValue], AfterValidator(_finite)]
"""What an experiment was asked for; any JSON object."""


class ExperimentRequest(WireModel):
    """An experiment that a page begins."""

    name: ExperimentName
    plan: Plan
    planned: int | None = Field(default=None, ge=0)
    """How many runs it is to have."""


class ExperimentCreated(WireModel):
    """The answer to it."""

    id: str


class RunUpload(WireModel):
    """One run, after it has ended. Figures can be computed of whatever is valid here."""

    configuration: Configuration
    recording: Recording
    link: Entries[LinkSample]
    """What the shaper told of its link meanwhile; none without one."""
    scene_bytes: int | None = Field(default=None, ge=0, le=MOST_BYTES)
    """Of the scene's file; None if unknown."""
    scene_sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
    """Of it, too, in hexadecimal digits; None if unknown, or if there is no file."""
    backend: Backend | None = None
    """What made the link's delay; None without a shaper."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        for problem in self._problems():
            raise ValueError(problem)
        return self

    def _problems(self) -> Iterator[str]:
        configuration, recording = self.configuration, self.recording
        if recording.scene != configuration.scene:
            yield f"the recording is of the scene {recording.scene!r}, not of {configuration.scene!r}"
        if recording.mode != configuration.mode.partition("-")[0]:
            yield f"the recording is of the mode {recording.mode}, not of {configuration.mode}"
        if abs(recording.duration_ms - configuration.duration_s * 1000) > 1:
            yield f"the recording lasts {recording.duration_ms:g} ms, not {configuration.duration_s:g} s"
        if not 0 <= recording.started_unix_ms <= LATEST_UNIX_MS:
            yield "the recording started at no time of this century"
        if recording.traffic and max(entry.bytes for entry in recording.traffic) > MOST_BYTES:
            yield "nobody receives so many bytes"
        link = self.link
        if any(later.at < earlier.at or later.drops < earlier.drops for earlier, later in pairwise(link)):
            yield "the times and the drops of link must not go back"
        rates = (rate for at in link for rate in (at.target_kbps, at.delivered_kbps, at.up_delivered_kbps))
        if not all(0 <= rate <= MOST_KBPS for rate in rates):
            yield f"the rates of link must be 0 to {MOST_KBPS:g} kbit/s"
        last = recording.duration_ms + AROUND_MS
        lists = (recording.inputs, recording.frames, recording.replies, recording.requests, recording.traffic, link)
        for entries in lists:  # in the order of time
            if entries and not -AROUND_MS <= entries[0].at <= entries[-1].at <= last:
                yield "something was recorded long before the run or long after it"
        if recording.ended_ms > last:
            yield "the recording ended long after the run"


class SampleCounts(WireModel):
    """What is known of a run's samples."""

    samples: int
    identical: int
    """So many frames came again, byte for byte."""
    different: int
    """So many came otherwise: ground truth may be of another renderer than the frames."""
    missing: int
    """Of so many something is not there yet."""


class InterruptedRun(WireModel):
    """A run of which a page has nothing but samples, because it was closed before the run's end."""

    configuration: Configuration
    started_unix_ms: float = Field(ge=0, le=LATEST_UNIX_MS)


class SampleIndex(WireModel):
    """All samples of a run, once their pictures are in the store."""

    samples: Annotated[tuple[Sample, ...], Field(min_length=1, max_length=MOST_SAMPLES, fail_fast=True)]


class UploadedFile(WireModel):
    """A picture of a sample."""

    name: str
    bytes: int


class UploadedSamples(WireModel):
    """What a store has of a run's samples: whoever goes on sends only the rest."""

    complete: bool
    """Their index is there, too."""
    files: Entries[UploadedFile]


class RunRow(WireModel):
    """One run of an experiment."""

    folder: str
    status: Literal["running", "complete", "failed"]
    """A run that was killed says `running` for ever."""
    problem: str | None
    """Why there are no figures."""
    configuration: Configuration
    figures: Figures | None
    samples: SampleCounts | None
    """null of a run without any."""
    saturated_share: float | None = None
    """Of the run's time, the share in which all processors were busy, if that was so often that latencies tell of the
    machine, too; null otherwise, and if it is unknown."""


class ExperimentSummary(WireModel):
    """One experiment in the list."""

    id: str
    name: str
    created: str
    """ISO 8601, UTC."""
    source: Literal["command", "page"]
    planned: int | None = None
    """How many runs it has when it is complete; null if it does not say."""
    runs: int
    """That were made, whatever became of them."""
    complete: int
    """Of these."""
    sampled: int
    """Of these, runs that have samples."""


class ExperimentList(WireModel):
    """All experiments, the newest first."""

    experiments: Entries[ExperimentSummary]


class Experiment(WireModel):
    """One experiment and its runs."""

    id: str
    name: str
    created: str
    source: Literal["command", "page"]
    plan: Plan
    """As it was given."""
    complete: int
    runs: Entries[RunRow]


class SampleRow(WireModel):
    """One sample of a run. Pictures are names of files (`/experiments/{id}/runs/{run}/samples/{name}`), or null."""

    seq: int
    at: float
    """When it was on the screen, ms of the run's clock."""
    rung: int | None
    bytes: int
    width: int
    height: int
    """Of the picture as it was shown, in pixels."""
    restore: str
    upscale: str
    enhance_ms: float | None
    original: str | None
    """The frame as it came."""
    enhanced: str | None
    """The picture as it was shown."""
    truth: str | None
    """The same view without loss."""
    replayed: str | None
    """What the same request got later, if that differs."""
    identical: bool | None
    """Whether it got the same; null if that is not known."""
    problem: str | None
    """Why something is missing."""


class SampleList(WireModel):
    """The samples of a run, in the order of time."""

    samples: Entries[SampleRow]
    problem: str | None
    """Why there are none, if they cannot be read."""


class Materialisation(WireModel):
    """How far the samples of an experiment are, rendered again."""

    state: Literal["idle", "running"]
    done: int
    total: int
    """Samples."""
    problem: str | None
    """What went wrong the last time."""


class Movement(WireModel):
    """A movement trace."""

    name: str
    duration_ms: float = Field(ge=0)
    anchor: Literal["start", "scene"]
    """Placed at the scene's start camera, or absolute in the scene."""
    description: str


class MovementList(WireModel):
    """All movement traces, by name."""

    movements: Entries[Movement]
