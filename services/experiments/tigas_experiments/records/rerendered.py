"""Results of rendering a run's samples again.

materialised.ndjson             one Rerendered per line; grows while samples are rendered
samples/000123.replayed.jpg     the frame rendered again, if it differs from the run's frame
samples/000123.truth.png        ground truth: the same view without loss, in its displayed size
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from pydantic import Field, ValidationError

from tigas_common.files import read_regular
from tigas_common.wire.model import WireModel
from tigas_experiments.records.files import MAX_FILE_BYTES, BrokenRecording
from tigas_experiments.records.samples import read_samples
from tigas_experiments.wire.recording import Sample

INDEX = "materialised.ndjson"
REPLAYED = "replayed.jpg"
TRUTH = "truth.png"


class Rerendered(WireModel):
    """One sample."""

    seq: int = Field(ge=0, lt=2**32)
    """Sequence number of the sample."""
    identical: bool | None
    """Whether the same request got the same bytes again; None if they could not be compared."""
    problem: str | None
    """Reason for missing data, which is requested again the next time."""
    psnr_db: float | None = None
    """PSNR between differing frames: far above 40 dB for rounding, far below for another scene."""


def read_rerendered(run: Path) -> dict[int, Rerendered]:
    """The latest result of each sample, by sequence number; empty without any.

    Invalid lines are ignored, because the writer may have been killed. Raises BrokenRecording.
    """
    path = run / INDEX
    try:
        lines = read_regular(path, MAX_FILE_BYTES, follow=False).splitlines()
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise BrokenRecording(f"{path} cannot be read: {error.strerror or error}.") from None
    found = {}
    for line in lines:
        try:
            entry = Rerendered.model_validate_json(line)
        except ValidationError:
            continue
        found[entry.seq] = entry
    return found


@dataclass(frozen=True, slots=True)
class SampledRun:
    """A run's samples and the results of rendering them again."""

    folder: str
    samples: tuple[Sample, ...]
    known: Mapping[int, Rerendered]
    """Results by sequence number."""
    problem: str | None = None
    """Reason why the remaining samples were skipped, or a problem of the records."""

    def _count(self, found: Callable[[Rerendered], bool]) -> int:
        return sum(sample.seq in self.known and found(self.known[sample.seq]) for sample in self.samples)

    @property
    def identical(self) -> int:
        """Number of frames that were identical, byte for byte."""
        return self._count(lambda one: one.identical is True)

    @property
    def different(self) -> int:
        """Number of frames that differed from the run's."""
        return self._count(lambda one: one.identical is False)

    @property
    def missing(self) -> int:
        """Number of incomplete samples."""
        return len(self.samples) - self._count(lambda one: one.problem is None)

    @property
    def problems(self) -> list[str]:
        """Why, each reason once."""
        told = [self.problem, *(self.known[one.seq].problem for one in self.samples if one.seq in self.known)]
        return list(dict.fromkeys(each for each in told if each is not None))


def sampled_run(run: Path) -> SampledRun:
    """The current state of a run's samples, from its folder."""
    try:
        return SampledRun(run.name, tuple(read_samples(run)), read_rerendered(run))
    except BrokenRecording as error:
        return SampledRun(run.name, (), {}, str(error))


@contextmanager
def rerender_log(run: Path) -> Iterator[TextIO]:
    """Open the file for appending; a partial line of a killed process is terminated first. Raises OSError."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
    with os.fdopen(os.open(run / INDEX, flags, 0o666), "r+", encoding="utf-8") as file:
        if file.seek(0, os.SEEK_END):
            file.write("\n")
        yield file


def append_rerendered(file: TextIO, entry: Rerendered) -> None:
    """Append the result of one more sample. Raises OSError."""
    file.write(f"{entry.model_dump_json()}\n")
    file.flush()
