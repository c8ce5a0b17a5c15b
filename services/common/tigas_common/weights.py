"""Weights files of the networks that enhance a ladder's low rungs: safetensors with metadata, strictly validated.

Each rung has a network: `rung{N}.conv{i}.weight` [out, in, 3, 3] and `rung{N}.conv{i}.bias` [out] from i = 0, float16.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import NDArray
from pydantic import Field

from tigas_common.errors import TigasError
from tigas_common.files import read_regular, replace_file
from tigas_common.parsing import parse, quotable
from tigas_common.wire.model import MAX_SIDE, Entries, WireModel
from tigas_common.wire.render import Rung

ARCHITECTURE = "tigas-sr-1"
FILE = "enhance.safetensors"
"""The file's name in a scene's folder."""
GENERAL = "general"
"""Value of `scene_sha256` for weights trained on several scenes, which suit any scene."""
MAX_BYTES = 1_000_000
MAX_HEIGHT_RATIO = 1.25
"""A network serves rungs from its own rung's height divided by this factor up to its multiple."""
_METADATA = ("architecture", "scene_sha256", "networks", "created", "version")


class BrokenWeights(TigasError):
    status, type, title = 422, "broken-weights", "The enhancement's weights cannot be used"


class NetworkInfo(WireModel):
    """One rung's network and how it was trained."""

    rung: int = Field(ge=1, le=15)
    width: int = Field(ge=16, le=MAX_SIDE)
    height: int = Field(ge=16, le=MAX_SIDE)
    quality: int = Field(ge=1, le=100)
    """JPEG quality of the rung, in the ladder for which it was trained."""
    scale: Literal[1, 2]
    """The enhanced image's size relative to the rung's."""
    layers: int = Field(ge=2, le=8)
    channels: int = Field(ge=4, le=32, multiple_of=4)
    """A multiple of four, as the page's shaders process channels in fours."""
    gain_db: float | None = None
    """Gain in PSNR on held-out views over bicubic enlargement, in dB, at display size."""

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of all tensors."""
        widths = [3, *[self.channels] * (self.layers - 1), 3 * self.scale**2]
        shapes: dict[str, tuple[int, ...]] = {}
        for i in range(self.layers):
            shapes[f"rung{self.rung}.conv{i}.weight"] = (widths[i + 1], widths[i], 3, 3)
            shapes[f"rung{self.rung}.conv{i}.bias"] = (widths[i + 1],)
        return shapes


class _Networks(WireModel):
    networks: Entries[NetworkInfo]


def distance(trained: NetworkInfo | Rung, rung: Rung) -> tuple[float, int]:
    """Distance between a network's own rung and another rung: by height, then by quality."""
    return abs(math.log(trained.height / rung.height)), abs(trained.quality - rung.quality)


@dataclass(frozen=True, slots=True)
class Weights:
    scene_sha256: str
    """SHA-256 of the training scene's file in hexadecimal, or GENERAL."""
    networks: tuple[NetworkInfo, ...]
    tensors: Mapping[str, NDArray[np.float16]]
    created: str
    """Time of training, in ISO 8601."""
    version: str
    """Version of TIGAS."""

    def misfit(self, scene_sha256: str | None, ladder: Sequence[Rung]) -> str | None:
        """Reason why these weights do not suit a scene with this file and ladder, in one sentence; None if they do."""
        if self.scene_sha256 not in (GENERAL, scene_sha256):
            return "The scene's file has changed since these weights were trained; train them again."
        if all(self.network_for(rung) is None for rung in ladder):
            return "These weights were trained for other frame sizes than the ladder's; train them again."
        return None

    def network_for(self, rung: Rung) -> NetworkInfo | None:
        """The network trained for the height nearest to a rung's, within a factor of MAX_HEIGHT_RATIO.

        Ties are broken by the nearer quality. None if the rung's frames are to be enlarged bicubically.
        """
        near = [each for each in self.networks if 1 / MAX_HEIGHT_RATIO <= each.height / rung.height <= MAX_HEIGHT_RATIO]
        return min(near, key=lambda each: distance(each, rung), default=None)

    def to_bytes(self) -> bytes:
        networks = [network.model_dump() for network in self.networks]
        metadata = {
            "architecture": ARCHITECTURE,
            "scene_sha256": self.scene_sha256,
            "networks": json.dumps(networks),
            "created": self.created,
            "version": self.version,
        }
        return safetensors.numpy.save(dict(self.tensors), metadata)


def write_weights(path: Path, weights: Weights) -> None:
    """Write a file atomically. Raises OSError."""
    replace_file(path, weights.to_bytes())


def read_weights(path: Path) -> Weights:
    """Read a weights file. Raises BrokenWeights with one sentence, and OSError if the file is missing or unreadable."""
    return parse_weights(read_regular(path, MAX_BYTES))


def parse_weights(content: bytes) -> Weights:
    """Parse a weights file's content. Raises BrokenWeights with one sentence."""
    if len(content) > MAX_BYTES:
        raise BrokenWeights(f"The weights file has more than {MAX_BYTES:,} bytes.")
    try:
        found = safetensors.numpy.load(content)
    except (safetensors.SafetensorError, KeyError, TypeError, ValueError):
        raise BrokenWeights("The weights are not a complete safetensors file.") from None
    metadata = _metadata(content)
    if metadata["architecture"] != ARCHITECTURE:
        known = quotable(metadata["architecture"], 60)
        raise BrokenWeights(f"The weights are for the architecture {known!r}; this is {ARCHITECTURE!r}.")
    networks = _networks(metadata["networks"])
    expected = {name: shape for network in networks for name, shape in network.shapes.items()}
    for name, shape in expected.items():
        tensor = found.get(name)
        if tensor is None or tensor.shape != shape or tensor.dtype != np.float16:
            raise BrokenWeights(f"The weights lack {name} as 16-bit floats of shape {list(shape)}.")
        if not np.isfinite(tensor).all():
            raise BrokenWeights(f"The weights in {name} are not all finite.")
    if len(found) > len(expected):
        raise BrokenWeights("The weights file has tensors that belong to no network.")
    return Weights(metadata["scene_sha256"], networks, found, metadata["created"], metadata["version"])


def _metadata(content: bytes) -> dict[str, str]:
    """The metadata of a valid safetensors file."""
    header: Any = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    metadata: dict[str, str] = header.get("__metadata__") or {}
    if missing := next((name for name in _METADATA if name not in metadata), None):
        raise BrokenWeights(f"The weights file does not name its {missing}.")
    return metadata


def _networks(text: str) -> tuple[NetworkInfo, ...]:
    try:
        networks = parse(_Networks, f'{{"networks":{text}}}'.encode()).networks
    except TigasError as error:
        raise BrokenWeights(f"The list of networks is not valid: {error.detail}") from None
    if not networks or len({network.rung for network in networks}) < len(networks):
        raise BrokenWeights("The list of networks must have at least one rung, and each only once.")
    return networks
