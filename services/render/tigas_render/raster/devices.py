"""Chooses the rasteriser for a device."""

from __future__ import annotations

import logging
import shutil
from importlib.util import find_spec
from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.installation import check_versions, install_command
from tigas_render.local_files import cache_directory
from tigas_render.raster.base import Rasterizer
from tigas_render.raster.instant import NAME, InstantRasterizer

logger = logging.getLogger(__name__)

GPU_PACKAGES = ("torch", "cuda.core", "cuda.pathfinder")
"""Packages in the extra `gpu`."""


def create_rasterizer(device: str, cache: Path | None = None) -> Rasterizer:
    """Create the rasteriser for `cpu`, `cuda`, `cuda:N` or `auto`, which uses a GPU if possible.

    On a machine with NVIDIA's driver, `auto` logs why it falls back to the CPU.
    cache: a directory for compiled kernels, by default the user's cache.
    Raises ValueError, with one sentence, if the machine has no such device.
    """
    if device.startswith(NAME):
        return InstantRasterizer(*map(int, device.split(":")[1:]))
    if device != "cpu":
        missing = cuda_problem()
        if missing is None:
            from tigas_render.raster.cuda.rasterizer import CudaRasterizer

            try:
                return CudaRasterizer(_index(device), cache or cache_directory())
            except ValueError as error:
                if device != "auto":
                    raise
                missing = str(error)
        elif device != "auto":
            raise ValueError(f"{missing} Start the service with --device cpu, or correct this.")
        if shutil.which("nvidia-smi"):  # installed with NVIDIA's driver
            logger.warning("Rendering on the CPU. %s", missing)
    from tigas_render.raster.cpu import CpuRasterizer

    return CpuRasterizer()


def cuda_problem() -> str | None:
    """Why this machine cannot render on a GPU, in one sentence; None if it can."""
    try:
        complete = all(find_spec(package) for package in GPU_PACKAGES)
    except ModuleNotFoundError:
        complete = False
    if not complete:
        return f"The packages for GPUs are missing ({install_command('gpu')})."
    try:
        check_versions("cuda-core")
    except StartError as error:
        return str(error)
    import torch  # takes seconds, so only where there may be a GPU

    if torch.version.cuda is None:
        return "The installed PyTorch is built without CUDA."
    if not torch.cuda.is_available():
        return "PyTorch finds no NVIDIA GPU and driver on this machine."
    return None


def _index(device: str) -> int:
    import torch

    index = int(device.partition(":")[2] or 0)
    if index >= torch.cuda.device_count():
        raise ValueError(f"There is no {device}: this machine has {torch.cuda.device_count()} GPUs, counted from 0.")
    return index
