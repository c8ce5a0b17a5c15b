"""The shaders of a file of networks, as `web/scripts/enhance-wgsl.mjs` writes them into a folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Precision = Literal["f16", "f32"]


@dataclass(frozen=True)
class Layer:
    code: str
    tile: tuple[int, int]
    """Pixels of the frame that a workgroup computes."""


@dataclass(frozen=True)
class NetworkShaders:
    """One network."""

    rung: int
    width: int
    height: int
    """Pixels of the rung."""
    scale: int
    channels: int
    multiplications: int
    """Multiply-accumulate operations for each of them."""
    layers: dict[Precision, list[Layer]]


def read_shaders(folder: Path) -> list[NetworkShaders]:
    """All networks of a folder."""

    def layer(entry: dict[str, Any]) -> Layer:
        return Layer((folder / entry["file"]).read_text(), tuple(entry["tile"]))

    networks: list[dict[str, Any]] = json.loads((folder / "shaders.json").read_text())
    for network in networks:
        network["layers"] = {
            precision: [layer(entry) for entry in entries] for precision, entries in network["layers"].items()
        }
    return [NetworkShaders(**network) for network in networks]
