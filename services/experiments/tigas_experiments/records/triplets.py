"""Triplets of a sample: received frame, enhanced picture as displayed, and ground truth.

Also found in any folder with `samples/`. For kept pictures of a run: the displayed picture, and ground truth of the
viewer's pose.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tigas_experiments.quality.picture import BrokenPicture, Picture, decode, decode_shown, enlarged, upscaled
from tigas_experiments.records.rerendered import TRUTH
from tigas_experiments.records.samples import ENHANCED, JPEG, read_sample_file

LEAST_SIDE, MOST_PIXELS = 32, 3840 * 2160
"""Limits of ground truth. VIFp's lowest scale is an eighth as large; DISTS takes 13 GB for a pair of the largest."""
Kind = Literal["original", "enhanced", "seen"]
KINDS: tuple[Kind, ...] = ("original", "enhanced", "seen")


@dataclass(frozen=True, slots=True)
class Triplet:
    """The files of one sample, or of one kept picture, that has a ground truth."""

    seq: int
    """Sequence number; index of a kept picture."""
    pictures: dict[Kind, Path]
    """The original, the enhanced picture, or both; or the displayed picture."""
    truth: Path

    @property
    def name(self) -> str:
        """For people."""
        return f"{'picture' if 'seen' in self.pictures else 'sample'} {self.seq}"

    def read(self) -> Contents:
        """Raises BrokenRecording."""
        pictures = {kind: read_sample_file(path) for kind, path in self.pictures.items()}
        return Contents(pictures, read_sample_file(self.truth))


@dataclass(frozen=True, slots=True)
class Contents:
    """File contents of one sample."""

    pictures: dict[Kind, bytes]
    truth: bytes

    def digest(self, kind: Kind) -> str:
        """Digest of a picture and its ground truth, 16 hexadecimal digits."""
        parts = (self.pictures[kind], self.truth)
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]

    def decoded(self) -> tuple[Picture, dict[Kind, Picture]]:
        """Ground truth, and the pictures at its size: originals by bicubic, displayed pictures by bilinear on black.

        Raises BrokenPicture.
        """
        truth = decode(self.truth)
        height, width = truth.shape[:2]
        if min(height, width) < LEAST_SIDE or height * width > MOST_PIXELS:
            raise BrokenPicture(f"Its ground truth has {width}×{height} pixels; 32×32 to 3840×2160 can be compared.")
        found: dict[Kind, Picture] = {}
        for kind, data in self.pictures.items():
            picture = decode_shown(data)[0] if kind == "seen" else decode(data)
            if kind == "seen":
                picture = enlarged(picture, width, height)
            elif kind == "original":
                picture = upscaled(picture, width, height)
            elif picture.shape != truth.shape:
                shown = f"{picture.shape[1]}×{picture.shape[0]}"
                raise BrokenPicture(f"It was shown at {shown}, but its ground truth has {width}×{height} pixels.")
            found[kind] = picture
        return truth, found


def triplets(run: Path) -> list[Triplet]:
    """The samples that have a ground truth and something to compare with it, by number. Raises OSError."""
    kinds: dict[str, Kind | None] = {JPEG: "original", TRUTH: None, **dict.fromkeys(ENHANCED, "enhanced")}
    pictures: dict[int, dict[Kind, Path]] = {}
    truths: dict[int, Path] = {}
    folder = run / "samples"
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        number, _, suffix = path.name.partition(".")
        if not re.fullmatch("[0-9]{1,10}", number) or suffix not in kinds:
            continue
        if kind := kinds[suffix]:
            pictures.setdefault(int(number), {}).setdefault(kind, path)
        else:
            truths[int(number)] = path
    return [Triplet(seq, pictures[seq], truths[seq]) for seq in sorted(truths.keys() & pictures.keys())]


def seen(run: Path) -> list[Triplet]:
    """The kept pictures that have a ground truth, in their order. Raises OSError."""
    folder = run / "captures"
    found = []
    for truth in sorted(folder.glob(f"*.{TRUTH}")) if folder.is_dir() else ():
        number = truth.name.partition(".")[0]
        picture = folder / f"{number}.png"
        if re.fullmatch("[0-9]{4,10}", number) and picture.exists():
            found.append(Triplet(int(number), {"seen": picture}, truth))
    return found
