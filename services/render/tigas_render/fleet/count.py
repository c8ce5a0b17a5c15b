"""How many edges there are to be."""

from __future__ import annotations

import sys

from tigas_common.errors import StartError
from tigas_common.processors import usable_processors
from tigas_render.fleet.devices import has_gpu
from tigas_render.settings import RenderSettings

MIN_CORES = 8
"""With fewer, or without a GPU, a single process does all: edges would take from the renderer what they win."""
MAX_AUTO = 8
"""For each device."""


def edges_for(settings: RenderSettings, devices: int) -> int:
    """The setting, or what suits this machine and so many devices. Raises StartError where there cannot be several."""
    if settings.edges is not None:
        if settings.edges > 1 and sys.platform != "linux":
            raise StartError("Several edges need Linux; start the service with --edges 1.")
        return settings.edges
    return suitable(usable_processors() if sys.platform == "linux" else 1, _has_gpu(settings.device), devices)


def suitable(cores: int, gpu: bool, devices: int) -> int:
    """Three eighths of the cores: the engine's event loop and its lanes need two or three of 16 (docs/load.md)."""
    return min(cores * 3 // 8, MAX_AUTO * devices) if gpu and cores >= MIN_CORES else 1


def _has_gpu(device: str) -> bool:
    return device != "cpu" and (device != "auto" or has_gpu())
