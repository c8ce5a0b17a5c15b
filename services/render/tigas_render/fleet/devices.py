"""Which devices the service renders on: an engine each."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

from tigas_common.errors import StartError
from tigas_render.settings import RenderSettings

DEV = Path("/dev")
COUNT = (sys.executable, "-P", "-m", "tigas_render.raster.count_gpus")
COUNT_S = 30.0
"""A driver that has not answered by then answers no engine, either."""


def devices_for(settings: RenderSettings) -> tuple[str, ...]:
    """The devices that are set; all GPUs for `cuda`, and for `auto` where there are several. Raises StartError."""
    devices = tuple(settings.device.split(","))
    if settings.device in ("auto", "cuda") and (gpus := _visible_gpus()) > 1:
        devices = tuple(f"cuda:{number}" for number in range(gpus))
    for device, times in Counter(devices).items():
        if times > 1 and device.startswith("cuda"):
            raise StartError(f"{device} is named twice; an engine has a GPU to itself.")
    if len(devices) > 1 and sys.platform != "linux":
        raise StartError("Several devices need Linux; choose one with --device.")
    return devices


def names(devices: tuple[str, ...]) -> tuple[str, ...]:
    """What each is called; no two are called the same."""
    times = Counter(devices)
    return tuple(f"{device}#{number}" if times[device] > 1 else device for number, device in enumerate(devices))


def has_gpu() -> bool:
    """Whether an NVIDIA driver has found a GPU: on Linux, or in Windows' Linux."""
    return bool(_nodes()) or (DEV / "dxg").exists()


def _nodes() -> list[Path]:
    return list(DEV.glob("nvidia[0-9]*"))


def _visible_gpus() -> int:
    """How many GPUs CUDA shows. It is asked in a process of its own, and only where there may be several."""
    if sys.platform != "linux" or (len(_nodes()) < 2 and not (DEV / "dxg").exists()):
        return len(_nodes())
    try:
        return int(subprocess.run(COUNT, capture_output=True, check=True, timeout=COUNT_S).stdout)
    except (subprocess.SubprocessError, ValueError):
        return 1  # whose engine says what is wrong
