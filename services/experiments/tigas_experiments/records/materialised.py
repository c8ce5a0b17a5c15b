"""What became of a run's samples when a render service was asked for them again.

materialised.ndjson             a Materialised a line; grows while samples are asked for
samples/000123.replayed.jpg     what the render service sent then, if it differs from what came in the run
samples/000123.truth.png        ground truth: the same view without loss, in the size that it was shown in
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from pydantic import Field, ValidationError

from tigas_common.files import read_regular
from tigas_common.wire.model import WireModel
from tigas_experiments.records.lines import MAX_FILE_BYTES
from tigas_experiments.records.recording import BrokenRecording

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
