"""What was on the screen at one moment of a run, beside what the viewer should have seen then."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, enlarged
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.summary import Summary
from tigas_experiments.report.comparison_table import label

MAX_WIDTH = 640
JPEG_QUALITY = 82


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Two pictures of one moment, as data: URLs."""

    label: str
    at_s: float
    shown: str
    view: str


def snapshots(folder: Path, runs: Sequence[Summary]) -> list[Snapshot]:
    """Of an experiment's complete runs that kept one; one that is broken costs nothing else."""
    found: list[Snapshot] = []
    for run in runs:
        if run.figures is not None:
            with suppress(BrokenRecording, BrokenPicture):
                if (stored := StoredRun(folder / "runs" / run.folder).snapshot()) is not None:
                    at, shown, view = stored
                    found.append(_snapshot(label(run.record), at / 1000, decode(shown), decode(view)))
    return found


def _snapshot(label: str, at_s: float, shown: Picture, view: Picture) -> Snapshot:
    height, width = view.shape[:2]
    return Snapshot(label, at_s, _url(enlarged(shown, width, height)), _url(view))


def _url(picture: Picture) -> str:
    image = Image.fromarray(picture)
    image.thumbnail((MAX_WIDTH, MAX_WIDTH))
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=JPEG_QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode()}"
