"""Services that benchmarks start, each in its own process, on ports of 127.0.0.1."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil

from tigas_common.errors import StartError
from tigas_common.processes import run_process, tigas_command

START_S = 180
"""The first start on a machine compiles the rasteriser."""
STOP_S = 10


@dataclass(frozen=True, slots=True)
class Service:
    """One running service."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    """Its output."""

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    @property
    def megabytes(self) -> float:
        """Resident memory of the service and the processes that it has started; 0 once it has ended."""
        return megabytes_of(self.process.pid)

    @property
    def open_files(self) -> int:
        """Of the same processes."""
        return open_files_of(self.process.pid)

    @property
    def cpu_s(self) -> float:
        """Seconds that its processes have computed, in user and kernel mode."""
        return _of_tree(self.process.pid, lambda process: process.cpu_times().user + process.cpu_times().system)

    def wait_until_healthy(self, port: int) -> None:
        """Wait until it answers. Raises StartError if it ends instead, or takes too long."""
        late = time.monotonic() + START_S
        while self.runs and time.monotonic() < late:
            try:
                if httpx.get(f"http://127.0.0.1:{port}/healthz", trust_env=False).is_success:
                    return
            except httpx.HTTPError:
                time.sleep(0.2)
        said = " ".join(self.log.read_text(errors="replace").splitlines()[-3:])
        raise StartError(f"tigas {self.name} does not start: {said}")


def megabytes_of(pid: int) -> float:
    """Resident memory of a process and its descendants that still run."""
    return _of_tree(pid, lambda process: process.memory_info().rss) / 1e6


def open_files_of(pid: int) -> int:
    """Open files of the same processes."""
    return int(_of_tree(pid, lambda process: process.num_fds()))


def _of_tree(pid: int, figure: Callable[[psutil.Process], float]) -> float:
    total = 0.0
    with suppress(psutil.NoSuchProcess):
        top = psutil.Process(pid)
        for process in (top, *top.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):
                total += figure(process)
    return total


@contextmanager
def started(name: str, *arguments: str, log: Path, **environment: str) -> Iterator[Service]:
    """A `tigas` command, until the context ends."""
    with (
        log.open("ab") as file,
        run_process(
            tigas_command(name, *arguments), STOP_S, stdout=file, stderr=file, env=os.environ | environment
        ) as process,
    ):
        yield Service(name, process, log)


def free_ports(*kinds: socket.SocketKind) -> list[int]:
    """A free port of each kind."""
    with ExitStack() as stack:
        numbers = []
        for kind in kinds:
            sock = stack.enter_context(socket.socket(socket.AF_INET, kind))
            sock.bind(("127.0.0.1", 0))
            numbers.append(int(sock.getsockname()[1]))
    return numbers
