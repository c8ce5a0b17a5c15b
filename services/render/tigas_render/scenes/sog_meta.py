"""The meta.json of a SOG scene: its images, and the meaning of their bytes.

The format, version 2: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
"""

from __future__ import annotations

import re
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from tigas_common.errors import BrokenScene, InvalidRequest
from tigas_common.parsing import parse
from tigas_common.wire.model import Entries

MAX_META = 256 * 1024
"""Bytes; three codebooks take about 15,000."""
MOST_COUNT = 1 << 27
"""Gaussians: more have no room in an image of WebP that Pillow opens."""
PALETTE_WIDTH = 64
"""Entries of the palette in a row of its image."""

PLAIN_NAME = re.compile(r"[\w-][\w .-]{0,99}", re.ASCII)

Triple = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Codebook = Annotated[Entries[FiniteFloat], Field(min_length=256, max_length=256)]
Name = Annotated[str, Field(max_length=100)]


class _Part(BaseModel):
    """Unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class Means(_Part):
    """Positions, as sign(x) · ln(1 + |x|) in 16 bits."""

    mins: Triple
    maxs: Triple
    files: tuple[Name, Name]
    """The lower bytes, and the upper ones."""


class Quaternions(_Part):
    """Rotations."""

    files: tuple[Name]


class Coded(_Part):
    """Scales, as logarithms, or first coefficients with opacities: bytes that choose from a codebook."""

    codebook: Codebook
    files: tuple[Name]


class Palette(_Part):
    """The other coefficients: each Gaussian chooses an entry."""

    count: int = Field(ge=1, le=1 << 16)
    bands: int = Field(ge=1, le=3)
    codebook: Codebook
    files: tuple[Name, Name]
    """The entries, and which of them a Gaussian has."""

    @property
    def coefficients(self) -> int:
        """Of each colour in an entry."""
        return (self.bands + 1) ** 2 - 1


class SogMeta(_Part):
    """The content of a meta.json."""

    version: Literal[2]
    count: int = Field(ge=1, le=MOST_COUNT)
    antialias: bool = False
    model: object = None
    means: Means
    scales: Coded
    quats: Quaternions
    sh0: Coded
    shN: Palette | None = None

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return self.shN.bands if self.shN else 0

    @property
    def antialiased(self) -> bool:
        """Whether it was trained so: splat-transform writes it as `model` since version 3."""
        return self.antialias or self.model == "antialiased"

    @property
    def names(self) -> tuple[str, ...]:
        """All images."""
        palette = self.shN.files if self.shN else ()
        return (*self.means.files, *self.scales.files, *self.quats.files, *self.sh0.files, *palette)

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for name in self.names:
            if not PLAIN_NAME.fullmatch(name):
                raise ValueError(f"{name[:40]!r} is not a plain name of a file next to it")
        return self


def parse_meta(name: str, content: bytes) -> SogMeta:
    """Read a meta.json; `name` is the scene file's, for people. Raises BrokenScene with one sentence."""
    if len(content) > MAX_META:
        raise BrokenScene(f"{name} has a meta.json of more than {MAX_META // 1024} KiB; that is no SOG.")
    try:
        return parse(SogMeta, content, MAX_META)
    except InvalidRequest as error:
        raise BrokenScene(f"{name} has a meta.json that is not one of SOG, version 2: {error.detail}") from None
