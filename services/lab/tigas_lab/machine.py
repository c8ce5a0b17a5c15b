"""What a figure depends on beside its configuration: versions and the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import psutil

from tigas_common.wire import WireModel

PACKAGES = ("aioquic", "av", "numba", "playwright", "scikit-image")


class Machine(WireModel):
    """Where a run was made."""

    system: str
    processor: str
    processors: int
    memory_gb: float
    python: str
    tigas: str
    commit: str | None
    """Of the working tree that the lab runs from, with `-dirty` if it was changed; None outside a repository."""
    packages: dict[str, str]


def this_machine() -> Machine:
    """As it is now."""
    return Machine(
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        processor=_processor(),
        processors=psutil.cpu_count() or 1,
        memory_gb=round(psutil.virtual_memory().total / 1e9, 1),
        python=platform.python_version(),
        tigas=_version("tigas") or "unknown",
        commit=_commit(),
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


def _commit() -> str | None:
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    try:
        run = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=10, env=os.environ, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip() or None
