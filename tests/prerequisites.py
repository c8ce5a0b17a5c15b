"""Prerequisites that a machine may lack: the only reasons for which a test is skipped."""

from __future__ import annotations

import functools
import os
import platform
import shutil
import socket
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import psutil
import pytest

from tigas_common.errors import StartError

ROOT = Path(__file__).resolve().parents[1]
STATIC = ROOT / "services/render/tigas_render/static/index.html"
"""Start page of the built web client."""


@dataclass(frozen=True)
class Prerequisite:
    """Something that tests need and a fresh machine may lack."""

    name: str
    install: str
    """Command or instruction that provides it."""
    found: Callable[[], bool]

    @property
    def reason(self) -> str:
        """Reason of every test that is skipped without it."""
        return f"{self.name}: {self.install}"

    @property
    def mark(self) -> pytest.MarkDecorator:
        """Mark for tests and modules that need it."""
        return pytest.mark.skipif(not self.found(), reason=self.reason)

    def require(self) -> None:
        """Skip the running test without it."""
        if not self.found():
            self.skip()

    def skip(self) -> NoReturn:
        """Skip the running test."""
        pytest.skip(self.reason)


def _command(name: str) -> Callable[[], bool]:
    return lambda: shutil.which(name) is not None


def _output(*argv: str) -> str | None:
    if shutil.which(argv[0]) is None:
        return None
    done = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True)
    return None if done.returncode else done.stdout.strip()


def _docker() -> bool:
    return None not in (_output("docker", "info"), _output("docker", "compose", "version"))


def _lab() -> bool:
    from tigas_testbed.namespaces import check_rights

    try:
        check_rights()
    except StartError:
        return False
    return True


def _free_lab() -> bool:
    from tigas_testbed.namespaces import Lab
    from tigas_testbed.services import NAME

    try:
        with Lab(NAME).up():
            pass
    except StartError:
        return False
    return not any(c.laddr.port == 8080 and c.status == "LISTEN" for c in psutil.net_connections("tcp") if c.laddr)


def _gpu() -> bool:
    from tigas_render.raster.devices import cuda_problem

    return cuda_problem() is None


def _nvrtc() -> bool:
    try:
        import cuda.core  # noqa: F401
    except ImportError:
        return False
    return True


def _metric_weights() -> bool:
    from tigas_experiments.quality.weights import SOURCES

    return all(source.cached.exists() for source in SOURCES)


def _ipv6() -> bool:
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6):
            return True
    except OSError:
        return False


def _whole_history() -> bool:
    return _output("git", "rev-parse", "--is-shallow-repository") == "false"


SHARED = Path(os.environ.get("TIGAS_SHARED", ROOT.parent / "shared"))
"""Captured scenes, which are never part of the repository."""
_APT = "sudo apt-get install"

CHROMIUM = Prerequisite("Chromium", f"{_APT} chromium", _command("chromium"))
FFMPEG = Prerequisite("ffmpeg", f"{_APT} ffmpeg", _command("ffmpeg"))
PROMTOOL = Prerequisite("promtool", f"{_APT} prometheus", _command("promtool"))
SETPRIV = Prerequisite("setpriv", f"{_APT} util-linux", _command("setpriv"))
LINUX = Prerequisite("Linux with glibc", "run the tests there", lambda: platform.libc_ver()[0] == "glibc")
SCHEDSTAT = Prerequisite(
    "run-queue delays of threads", "run the tests on Linux with CONFIG_SCHED_INFO", Path("/proc/self/schedstat").exists
)
IPV6 = Prerequisite("IPv6", "run the tests on a machine with the address ::1", _ipv6)
ROOT_RIGHTS = Prerequisite("root", "run the tests as root", lambda: os.geteuid() == 0)
NAMESPACES = Prerequisite(
    "network namespaces", f"run the tests as root after {_APT} iproute2 nftables ethtool procps", functools.cache(_lab)
)
FREE_LAB = Prerequisite("a free lab", "tigas lab down, and end what serves port 8080", _free_lab)
DOCKER = Prerequisite("Docker with Compose", f"{_APT} docker.io docker-compose-v2", functools.cache(_docker))
GPU = Prerequisite("an NVIDIA GPU", "make gpu", functools.cache(_gpu))
NVRTC = Prerequisite("NVRTC", "make gpu", _nvrtc)
WEBGPU = Prerequisite("WebGPU in Chromium", f"{_APT} chromium, in a version with SwiftShader", _command("chromium"))
BUILT_PAGE = Prerequisite("the built page", "cd web && npm ci && npm run build", STATIC.exists)
NODE_MODULES = Prerequisite(
    "the page's packages",
    "cd web && npm ci",
    lambda: shutil.which("node") is not None and (ROOT / "web/node_modules").exists(),
)
METRIC_WEIGHTS = Prerequisite("weights of LPIPS and DISTS", "tigas quality fetch", _metric_weights)
CAPTURED_SCENES = Prerequisite("captured scenes", "put them into ../shared, or set TIGAS_SHARED", SHARED.exists)
WHOLE_HISTORY = Prerequisite(
    "a clone with all commits", "git clone, or git fetch --unshallow", functools.cache(_whole_history)
)
