"""What became of a run's samples when a render service was asked for them again.

materialised.ndjson             a Materialised a line; grows while samples are asked for
samples/000123.replayed.jpg     what the render service sent then, if it differs from what came in the run
samples/000123.truth.png        ground truth: the same view without loss, in the size that it was shown in
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
from tigas_common.wire.recording import Sample
from tigas_experiments.records.lines import MAX_FILE_BYTES
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.samples import read_samples

INDEX = "materialised.ndjson"
REPLAYED = "replayed.jpg"
TRUTH = "truth.png"


class Materialised(WireModel):
    """One sample."""

    seq: int = Field(ge=0, lt=2**32)
    """Of the sample."""
    identical: bool | None
    """Whether the same request got the same bytes again; None if they could not be compared."""
    problem: str | None
    """Why something is missing; it is asked for again the next time."""
    psnr_db: float | None = None
    """Of the two frames to one another, where they differ: rounding is far above 40 dB, another scene far below."""


def read_materialised(run: Path) -> dict[int, Materialised]:
    """The last word on each sample, by sequence number; none of a run that was not materialised.

    A line that is none counts as not written: whoever wrote it may have been killed. Raises BrokenRecording.
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
            entry = Materialised.model_validate_json(line)
        except ValidationError:
            continue
        found[entry.seq] = entry
    return found


@dataclass(frozen=True, slots=True)
class SampledRun:
    """What is known of a run's samples."""

    folder: str
    samples: tuple[Sample, ...]
    known: Mapping[int, Materialised]
    """By sequence number."""
    problem: str | None = None
    """Why the rest was not even asked for, or what is wrong with the records."""

    def _count(self, found: Callable[[Materialised], bool]) -> int:
        return sum(sample.seq in self.known and found(self.known[sample.seq]) for sample in self.samples)

    @property
    def identical(self) -> int:
        """So many frames came again, byte for byte."""
        return self._count(lambda one: one.identical is True)

    @property
    def different(self) -> int:
        """So many came again otherwise than in the run."""
        return self._count(lambda one: one.identical is False)

    @property
    def missing(self) -> int:
        """Of so many something is missing."""
        return len(self.samples) - self._count(lambda one: one.problem is None)

    @property
    def problems(self) -> list[str]:
        """Why, each reason once."""
        told = [self.problem, *(self.known[one.seq].problem for one in self.samples if one.seq in self.known)]
        return list(dict.fromkeys(each for each in told if each is not None))


def sampled_run(run: Path) -> SampledRun:
    """What is known so far, from a run's folder."""
    try:
        return SampledRun(run.name, tuple(read_samples(run)), read_materialised(run))
    except BrokenRecording as error:
        return SampledRun(run.name, (), {}, str(error))


@contextmanager
def materialised_log(run: Path) -> Iterator[TextIO]:
    """The file, opened to say more; what a killed process left at its end is a line of its own. Raises OSError."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
    with os.fdopen(os.open(run / INDEX, flags, 0o666), "r+", encoding="utf-8") as file:
        if file.seek(0, os.SEEK_END):
            file.write("\n")
        yield file


def add_materialised(file: TextIO, entry: Materialised) -> None:
    """Say what became of one more sample. Raises OSError."""
    file.write(f"{entry.model_dump_json()}\n")
    file.flush()
