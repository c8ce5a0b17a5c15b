"""Dependencies of results apart from the configuration: versions, machines, and the render service."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Self

import psutil

from tigas_common.installation import this_commit
from tigas_common.wire.model import Entries, WireModel
from tigas_common.wire.render import CongestionControl, Rung, SceneInfo, ServerConfig

PACKAGES = ("aioquic", "av", "numba", "playwright", "scikit-image")


class Machine(WireModel):
    """The machine of the lab in which a run was made."""

    system: str
    processor: str
    processors: int
    memory_gb: float
    python: str
    tigas: str
    commit: str | None
    """Commit of the lab's code, with `-dirty` if modified; None if unknown."""
    packages: dict[str, str]


class Server(WireModel):
    """The render service of a run, possibly on another machine, as reported by itself."""

    version: str
    commit: str | None
    """Commit of its code."""
    device: str | None
    """Rendering device."""
    congestion_control: CongestionControl | None = None
    """Congestion control of HTTP/3; null in older records."""
    tcp_congestion_control: str | None = None
    """Congestion control of HTTP/1.1 and DASH; null in older records."""
    ladder: Entries[Rung]
    """Ladder to which the run's profiles refer: the scene's own, if it has one."""

    @classmethod
    def from_config(cls, config: ServerConfig, scene: SceneInfo | None = None) -> Self:
        own = scene.ladder if scene is not None else None
        return cls(
            version=config.version,
            commit=config.commit,
            device=config.device,
            congestion_control=config.congestion_control,
            tcp_congestion_control=config.tcp_congestion_control,
            ladder=own or config.ladder,
        )


def describe_machine() -> Machine:
    return Machine(
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        processor=_processor(),
        processors=psutil.cpu_count() or 1,
        memory_gb=round(psutil.virtual_memory().total / 1e9, 1),
        python=platform.python_version(),
        tigas=_version("tigas") or "unknown",
        commit=this_commit(),
        packages={name: found for name in PACKAGES if (found := _version(name))},
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name") and ":" in line)
    return next(names, platform.processor() or "unknown")
