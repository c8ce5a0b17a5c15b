"""Scored pictures of a run: samples and kept pictures with ground truth, and the metrics' values in scores.ndjson."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from tigas_common.wire.model import WireModel
from tigas_experiments.quality.metrics import PICTURE_METRICS, Name
from tigas_experiments.quality.picture import (
    BrokenPicture,
    Picture,
    decode,
    decode_screen,
    upscale_bicubic,
    upscale_bilinear,
)
from tigas_experiments.records.files import read_lines, write_lines
from tigas_experiments.records.samples import ENHANCED, FOLDER, JPEG, TRUTH, read_sample_file

SCORES = "scores.ndjson"
LEAST_SIDE, MOST_PIXELS = 32, 3840 * 2160
"""Limits on ground truth. VIFp's coarsest scale is an eighth as large; DISTS takes 13 GB for a pair of the largest."""
Kind = Literal["original", "enhanced", "seen"]
KINDS: tuple[Kind, ...] = ("original", "enhanced", "seen")
FILES: dict[str, dict[Kind, tuple[str, ...]]] = {
    FOLDER: {"enhanced": ENHANCED, "original": (JPEG,)},
    "captures": {"seen": ("png",)},
}
"""File name endings, after the number, of pictures in a run's folders."""
Values = Mapping[Name, float]


class Score(WireModel):
    """Scores of one picture against ground truth: a line of scores.ndjson. None is not computed."""

    seq: int = Field(ge=0)
    picture: Kind
    digest: str = Field(max_length=64)
    """Digest of the two pictures to which the score belongs."""
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
        return self.seq, self.picture

    @property
    def values(self) -> dict[Name, float]:
        every: dict[Name, float | None] = {metric.name: getattr(self, metric.name) for metric in PICTURE_METRICS}
        return {name: value for name, value in every.items() if value is not None}

    def has(self, names: Iterable[Name]) -> bool:
        return self.values.keys() >= set(names)


def read_scores(run: Path) -> list[Score]:
    """All scores of a run, by number; empty if there are none. Raises BrokenRecording."""
    path = run / SCORES
    return read_lines(path, Score) if path.exists() else []


def write_scores(run: Path, scores: Iterable[Score]) -> None:
    """Replace the file atomically. Raises OSError."""
    new = run / f"{SCORES}.new"
    in_order: list[Score] = sorted(scores, key=lambda score: score.key)
    write_lines(new, in_order)
    new.replace(run / SCORES)


@dataclass(frozen=True, slots=True)
class Triplet:
    """A ground truth, and the files to compare with it: a sample's received and enhanced frames, or a kept picture."""

    seq: int
    """Sequence number of a sample, or index of a kept picture."""
    pictures: dict[Kind, Path]
    truth: Path

    @property
    def name(self) -> str:
        return f"{'picture' if 'seen' in self.pictures else 'sample'} {self.seq}"

    def read(self) -> Contents:
        """Read the files. Raises BrokenRecording."""
        pictures = {kind: read_sample_file(path) for kind, path in self.pictures.items()}
        return Contents(pictures, read_sample_file(self.truth))


@dataclass(frozen=True, slots=True)
class Contents:
    pictures: dict[Kind, bytes]
    truth: bytes

    def digest(self, kind: Kind) -> str:
        """Digest of a picture and its ground truth, 16 hexadecimal digits."""
        parts = (self.pictures[kind], self.truth)
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]

    def decode(self) -> tuple[Picture, dict[Kind, Picture]]:
        """Ground truth, and the pictures scaled to its size: originals bicubically, displayed pictures bilinearly.

        Raises BrokenPicture.
        """
        truth = decode(self.truth)
        height, width = truth.shape[:2]
        if min(height, width) < LEAST_SIDE or height * width > MOST_PIXELS:
            raise BrokenPicture(f"Its ground truth has {width}×{height} pixels; 32×32 to 3840×2160 can be compared.")
        found: dict[Kind, Picture] = {}
        for kind, data in self.pictures.items():
            if kind == "seen":
                found[kind] = upscale_bilinear(decode_screen(data)[0], width, height)
            elif kind == "original":
                found[kind] = upscale_bicubic(decode(data), width, height)
            else:
                found[kind] = picture = decode(data)
                if picture.shape != truth.shape:
                    shown = f"{picture.shape[1]}×{picture.shape[0]}"
                    raise BrokenPicture(f"It was shown at {shown}, but its ground truth has {width}×{height} pixels.")
        return truth, found


def triplets(run: Path) -> list[Triplet]:
    """Samples and then kept pictures that have ground truth and something to compare, by number. Raises OSError.

    Any folder with `samples/` works; it need not be a run.
    """
    found = []
    for name, kinds in FILES.items():
        folder = run / name
        files = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
        numbers = [match[1] for file in files if (match := re.fullmatch(rf"([0-9]{{1,10}})\.{re.escape(TRUTH)}", file))]
        for number in sorted(numbers, key=int):
            pictures: dict[Kind, Path] = {}
            for kind, endings in kinds.items():
                if ending := next((each for each in endings if f"{number}.{each}" in files), None):
                    pictures[kind] = folder / f"{number}.{ending}"
            if pictures:
                found.append(Triplet(int(number), pictures, folder / f"{number}.{TRUTH}"))
    return found
