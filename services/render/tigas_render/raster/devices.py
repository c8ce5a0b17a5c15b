"""Chooses the rasteriser for a device."""

from __future__ import annotations

from typing import Literal

from tigas_render.raster.base import Rasterizer

Device = Literal["auto", "cpu", "cuda"]


def create_rasterizer(device: Device) -> Rasterizer:
    """The rasteriser for a device; `auto` takes the fastest that this machine has.

    Raises ValueError, with one sentence, if the machine has no such device.
    """
    if device == "cuda":
        raise ValueError("This version has no CUDA rasteriser; start it with --device cpu.")
    from tigas_render.raster.cpu import CpuRasterizer

    return CpuRasterizer()
