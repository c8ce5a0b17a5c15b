"""A run's samples: displayed frames with kept pictures, and the results of rendering them again.

samples.ndjson                  one Sample per line
samples/000123.jpg              the received frame of request 123
samples/000123.enhanced.webp    (or .png) the displayed picture without loss, if it was enhanced
materialised.ndjson             one Rerendered per line; grows while samples are rendered again
samples/000123.replayed.jpg     the frame rendered again, if it differs from the run's frame
samples/000123.truth.png        ground truth: the same view without loss, in its displayed size
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from pydantic import Field, ValidationError

from tigas_common.files import read_regular
from tigas_common.wire.model import WireModel
from tigas_experiments.records.files import MAX_FILE_BYTES, BrokenRecording, read_lines, write_lines
from tigas_experiments.wire.recording import Sample

INDEX = "samples.ndjson"
RERENDERED = "materialised.ndjson"
FOLDER = "samples"
JPEG = "jpg"
ENHANCED = ("enhanced.webp", "enhanced.png")
REPLAYED = "replayed.jpg"
TRUTH = "truth.png"
STAMP = ',"stamp":null'
"""End of a request in early records."""
MAX_PICTURE_BYTES = 64_000_000
"""Maximum size of a picture; a lossless one of the largest viewport hardly exceeds it."""


def sample_path(run: Path, seq: int, kind: str) -> Path:
    """Path of a sample's file with a suffix such as `jpg`."""
    return run / FOLDER / f"{seq:06}.{kind}"


def enhanced_path(run: Path, seq: int) -> Path | None:
    """Path of an enhanced sample's displayed picture, in either format; None without one."""
    return next((path for kind in ENHANCED if (path := sample_path(run, seq, kind)).is_file()), None)


def read_samples(run: Path) -> list[Sample]:
    """All samples of a run; empty if it was not sampled. Raises BrokenRecording."""
    path = run / INDEX
    if not path.exists():
        return []
    samples = read_lines(path, Sample, gone=STAMP)
    if len({sample.seq for sample in samples}) < len(samples):
        raise BrokenRecording(f"{path} has two samples with the same sequence number.")
    return samples


def read_sample_file(path: Path) -> bytes:
    """Read a stored picture. Raises BrokenRecording."""
    try:
        return read_regular(path, MAX_PICTURE_BYTES)
    except OSError as error:
        raise BrokenRecording(f"{path} cannot be read: {error.strerror or error}.") from None


def write_sample_file(run: Path, seq: int, kind: str, data: bytes) -> None:
    """Store a sample's picture. Raises OSError."""
    path = sample_path(run, seq, kind)
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)


def write_samples(run: Path, samples: Iterable[Sample]) -> None:
    """Write the index, once all pictures exist. Raises OSError."""
    write_lines(run / INDEX, samples)


class Rerendered(WireModel):
    """The result of rendering one sample again."""

    seq: int = Field(ge=0, lt=2**32)
    """Sequence number of the sample."""
    identical: bool | None
    """Whether the same request returned the same bytes again; None if they could not be compared."""
    problem: str | None
    """Reason for missing data, which is requested again the next time."""
    psnr_db: float | None = None
    """PSNR between the differing frames: far above 40 dB for rounding errors, far below for another scene."""


def read_rerendered(run: Path) -> dict[int, Rerendered]:
    """The latest result for each sample, by sequence number.

    Invalid lines are ignored, as the writer may have been killed. Raises BrokenRecording.
    """
    path = run / RERENDERED
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


@contextmanager
def rerender_log(run: Path) -> Iterator[TextIO]:
    """Open the file for appending, and terminate a partial line left by a killed process. Raises OSError."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
    with os.fdopen(os.open(run / RERENDERED, flags, 0o666), "r+", encoding="utf-8") as file:
        if file.seek(0, os.SEEK_END):
            file.write("\n")
        yield file


def append_rerendered(file: TextIO, entry: Rerendered) -> None:
    """Append the result for one more sample. Raises OSError."""
    file.write(f"{entry.model_dump_json()}\n")
    file.flush()


@dataclass(frozen=True, slots=True)
class SampledRun:
    """A run's samples and the results of rendering them again."""

    folder: str
    samples: tuple[Sample, ...]
    known: Mapping[int, Rerendered]
    """Results by sequence number."""
    problem: str | None = None
    """Reason why the remaining samples were skipped, or a problem with the records."""

    @property
    def _results(self) -> list[Rerendered]:
        return [self.known[one.seq] for one in self.samples if one.seq in self.known]

    @property
    def identical(self) -> int:
        """Number of frames that were identical byte for byte."""
        return sum(one.identical is True for one in self._results)

    @property
    def different(self) -> int:
        """Number of frames that differed from the run's."""
        return sum(one.identical is False for one in self._results)

    @property
    def missing(self) -> int:
        """Number of incomplete samples."""
        return len(self.samples) - sum(one.problem is None for one in self._results)

    @property
    def problems(self) -> list[str]:
        """Reasons for incomplete samples, each once."""
        reasons = (self.problem, *(one.problem for one in self._results))
        return list(dict.fromkeys(each for each in reasons if each is not None))


def read_sampled_run(run: Path) -> SampledRun:
    try:
        return SampledRun(run.name, tuple(read_samples(run)), read_rerendered(run))
    except BrokenRecording as error:
        return SampledRun(run.name, (), {}, str(error))
