"""File scores.ndjson of a run: each metric's value for each sampled picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import Field

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.metrics import PICTURE_METRICS, Name
from tigas_experiments.records.files import read_lines, write_lines
from tigas_experiments.records.triplets import Kind

SCORES = "scores.ndjson"
Values = Mapping[Name, float]


class Score(WireModel):
    """A line: one picture against its ground truth. None is not computed."""

    seq: int = Field(ge=0)
    picture: Kind
    digest: str = Field(max_length=64)
    """Digest of the two pictures that the score belongs to."""
    model: str | None = Field(default=None, max_length=210)
    """Enhancement model; None for originals, and if unknown."""
    psnr: float | None = None
    ssim: float | None = None
    vmaf: float | None = None
    vif: float | None = None
    lpips: float | None = None
    dists: float | None = None

    @property
    def key(self) -> tuple[int, Kind]:
        """Which picture it is of."""
        return self.seq, self.picture

    @property
    def values(self) -> dict[Name, float]:
        """The computed values."""
        every: dict[Name, float | None] = {metric.name: getattr(self, metric.name) for metric in PICTURE_METRICS}
        return {name: value for name, value in every.items() if value is not None}

    def has(self, names: Iterable[Name]) -> bool:
        """Whether all of these were computed."""
        return self.values.keys() >= set(names)

    def with_values(self, values: Values) -> Score:
        """And these."""
        return self.model_copy(update={str(name): value for name, value in values.items()})


def read_scores(run: Path) -> list[Score]:
    """All of a run, by number; none where none were computed. Raises BrokenRecording."""
    path = run / SCORES
    return read_lines(path, Score) if path.exists() else []


def write_scores(run: Path, scores: Iterable[Score]) -> None:
    """Replace the file atomically. Raises OSError."""
    new = run / f"{SCORES}.new"
    in_order: list[Score] = sorted(scores, key=lambda score: score.key)
    write_lines(new, in_order)
    new.replace(run / SCORES)
