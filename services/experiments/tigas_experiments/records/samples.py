"""A run's samples: displayed frames with kept pictures, so that they can be rendered again and compared.

    samples.ndjson                  one Sample per line
    samples/000123.jpg              the received frame of request 123
    samples/000123.enhanced.webp    (or .png) the displayed picture without loss, if it was enhanced

Other data of a sample also carry its number: `samples/000123.…`, or a line with its `seq`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tigas_common.files import read_regular
from tigas_experiments.records.files import BrokenRecording, read_lines, write_lines
from tigas_experiments.wire.recording import Sample

INDEX = "samples.ndjson"
FOLDER = "samples"
JPEG = "jpg"
ENHANCED = ("enhanced.webp", "enhanced.png")
STAMP = ',"stamp":null'
"""At the end of an older record's requests."""
MAX_PICTURE_BYTES = 64_000_000
"""A lossless picture of the largest viewport has hardly more."""


def sample_path(run: Path, seq: int, kind: str) -> Path:
    """Where a sample's file of a kind, such as `jpg`, is or belongs."""
    return run / FOLDER / f"{seq:06}.{kind}"


def enhanced_path(run: Path, seq: int) -> Path | None:
    """The picture that was shown, in the format that it has; None without one."""
    return next((path for kind in ENHANCED if (path := sample_path(run, seq, kind)).is_file()), None)


def read_samples(run: Path) -> list[Sample]:
    """All of a run; none where it was not sampled. Raises BrokenRecording."""
    path = run / INDEX
    if not path.exists():
        return []
    samples = read_lines(path, Sample, gone=STAMP)
    if len({sample.seq for sample in samples}) < len(samples):
        raise BrokenRecording(f"{path} has two samples of one sequence number.")
    return samples


def read_sample_file(path: Path) -> bytes:
    """A sample's picture. Raises BrokenRecording."""
    try:
        return read_regular(path, MAX_PICTURE_BYTES)
    except OSError as error:
        raise BrokenRecording(f"{path} cannot be read: {error.strerror or error}.") from None


def write_sample_file(run: Path, seq: int, kind: str, data: bytes) -> None:
    """Keep a sample's picture. Raises OSError."""
    path = sample_path(run, seq, kind)
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)


def write_samples(run: Path, samples: Iterable[Sample]) -> None:
    """Say which samples there are, once all of their files are. Raises OSError."""
    write_lines(run / INDEX, samples)
