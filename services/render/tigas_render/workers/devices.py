"""The choice of workers for a machine: an engine for each device, and the number of edges."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections import Counter
from pathlib import Path

from tigas_common.errors import StartError
from tigas_common.resources import usable_processors
from tigas_render.settings import RenderSettings
from tigas_render.transport.shared_port import attach_steering

DEV = Path("/dev")
COUNT_GPUS = "from cuda.bindings import driver; driver.cuInit(0); print(driver.cuDeviceGetCount()[1] or 0)"
"""Counts the GPUs in a separate process, because the driver stays loaded, and without PyTorch, which loads slowly."""
COUNT_COMMAND = (sys.executable, "-P", "-c", COUNT_GPUS)
COUNT_TIMEOUT_S = 30.0
"""Seconds for the driver to answer; if it takes longer, it would not answer an engine either."""
MIN_CORES = 8
"""Minimum number of cores for several edges. With fewer, or without a GPU, edges would slow down the renderer."""
MAX_EDGES_PER_DEVICE = 8
"""Maximum number of edges per device if the settings do not give one."""


def choose_devices(settings: RenderSettings) -> tuple[str, ...]:
    """Return the devices to use, which are all GPUs for `cuda`, and for `auto` with several GPUs. Raises StartError."""
    devices = tuple(settings.device.split(","))
    if settings.device in ("auto", "cuda") and (gpus := _visible_gpus()) > 1:
        devices = tuple(f"cuda:{number}" for number in range(gpus))
    for device, times in Counter(devices).items():
        if times > 1 and device.startswith("cuda"):
            raise StartError(f"{device} is named twice; each engine needs its own GPU.")
    if len(devices) > 1 and sys.platform != "linux":
        raise StartError("Several devices need Linux; choose one with --device.")
    return devices


def device_names(devices: tuple[str, ...]) -> tuple[str, ...]:
    """Return a unique name for each device."""
    times = Counter(devices)
    return tuple(f"{device}#{number}" if times[device] > 1 else device for number, device in enumerate(devices))


def choose_edge_count(settings: RenderSettings, devices: int) -> int:
    """Return the number of edges in the settings, or one that suits this machine. Raises StartError off Linux."""
    if settings.edges is not None:
        if settings.edges > 1 and sys.platform != "linux":
            raise StartError("Several edges need Linux; start the service with --edges 1.")
        return settings.edges
    gpu = settings.device != "cpu" and (settings.device != "auto" or has_gpu())
    return suggest_edge_count(usable_processors() if can_share_port() else 1, gpu, devices)


def suggest_edge_count(cores: int, gpu: bool, devices: int) -> int:
    """Return a number of edges, three eighths of the cores: an engine needs two or three of 16 (docs/deploy.md)."""
    return min(cores * 3 // 8, MAX_EDGES_PER_DEVICE * devices) if gpu and cores >= MIN_CORES else 1


def can_share_port() -> bool:
    """Whether the kernel can deliver each datagram of a shared port to the right edge."""
    if sys.platform != "linux":
        return False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        return attach_steering(sock, 2)


def has_gpu() -> bool:
    """Whether NVIDIA's driver has found a GPU, on Linux or in WSL."""
    return bool(_device_files()) or (DEV / "dxg").exists()


def _device_files() -> list[Path]:
    return list(DEV.glob("nvidia[0-9]*"))


def _visible_gpus() -> int:
    """Count the GPUs visible to CUDA, in a separate process, and only if there may be several."""
    if sys.platform != "linux" or (len(_device_files()) < 2 and not (DEV / "dxg").exists()):
        return len(_device_files())
    try:
        return int(subprocess.run(COUNT_COMMAND, capture_output=True, check=True, timeout=COUNT_TIMEOUT_S).stdout)
    except (subprocess.SubprocessError, ValueError):
        return 1  # its engine reports the error
