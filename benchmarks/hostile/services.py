"""The real services on loopback, each in its own process, over a scene small enough for one core."""

from __future__ import annotations

import json
import os
import resource
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, Self

import httpx
import numpy as np
import psutil

from reference.ply import write_ply
from tigas_common.processes import end, tigas
from tigas_render.gaussians import Gaussians

Name = Literal["render", "dash", "store", "shaper"]
GAUSSIANS = 5_000
SCENE = "ball"
START_S = 120
OPEN_FILES = 1024
"""Of a process, as most systems begin it."""
ACCESS, SERVICE = "10.9.1.1/24", "10.9.2.1/24"
"""The addresses of the shaper's two interfaces; there are no hosts behind them."""


@dataclass(frozen=True, slots=True)
class Ports:
    """Where the services listen, on 127.0.0.1."""

    quic: int
    render: int
    dash: int
    store: int
    shaper: int

    @classmethod
    def free(cls) -> Self:
        """Free ports."""
        with ExitStack() as stack:
            numbers = []
            for kind in (socket.SOCK_DGRAM, *[socket.SOCK_STREAM] * 4):
                sock = stack.enter_context(socket.socket(socket.AF_INET, kind))
                sock.bind(("127.0.0.1", 0))
                numbers.append(int(sock.getsockname()[1]))
        return cls(*numbers)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the output of `str`."""
        return cls(**json.loads(text))

    def __str__(self) -> str:
        return json.dumps(asdict(self))


@dataclass(frozen=True, slots=True)
class Service:
    """One running service."""

    name: Name
    process: subprocess.Popen[bytes]

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    @property
    def megabytes(self) -> float:
        """Resident memory of the service and the processes that it has started; 0 once it has ended."""
        try:
            family = [top := psutil.Process(self.process.pid), *top.children(recursive=True)]
        except psutil.NoSuchProcess:
            return 0.0
        total = 0
        for process in family:
            try:
                total += process.memory_info().rss
            except psutil.NoSuchProcess:
                continue
        return total / 1e6


@contextmanager
def running(
    wanted: Sequence[Name], ports: Ports, folder: Path, cores: set[int], device: str
) -> Iterator[dict[Name, Service]]:
    """Run the render service on a device, and the other wanted services, on these cores, as a context manager."""
    write_scene(folder / "models" / SCENE / f"{SCENE}.ply")
    commands = _commands(ports, folder, device)
    with ExitStack() as stack:
        services = {name: stack.enter_context(_service(name, commands[name], folder, cores)) for name in wanted}
        for name, service in services.items():
            _healthy(service, getattr(ports, name))
        yield services


def write_scene(path: Path) -> None:
    """A ball of coloured Gaussians around the origin: as hard to render as a small capture, and as good to look at."""
    path.parent.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    means = random.normal(size=(GAUSSIANS, 3))
    quaternions = random.normal(size=(GAUSSIANS, 4))
    arrays = (
        means / np.linalg.norm(means, axis=1, keepdims=True),
        np.exp(random.normal(-4.0, 0.5, (GAUSSIANS, 3))),
        quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        random.uniform(0.2, 0.95, GAUSSIANS),
        random.normal(0.0, 0.8, (GAUSSIANS, 1, 3)),
    )
    write_ply(path, Gaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays)))


def _commands(ports: Ports, folder: Path, device: str) -> dict[Name, list[str]]:
    def listens(port: int) -> tuple[str, str]:
        return "--http", f"127.0.0.1:{port}"

    models, results = str(folder / "models"), str(folder / "results")
    render = f"http://127.0.0.1:{ports.render}"
    return {
        "render": tigas("render", "--scenes", models, "--device", device, "--quic", f"127.0.0.1:{ports.quic}",
                        *listens(ports.render)),
        "dash": tigas("dash", "--render", render, *listens(ports.dash)),
        "store": tigas("store", "--results", results, *listens(ports.store)),
        "shaper": tigas("shaper", "--access", "access", "--service", "service", "--forward", "tcp:8080=10.9.2.2:8080",
                        *listens(ports.shaper)),
    }  # fmt: skip


@contextmanager
def _service(name: Name, command: list[str], folder: Path, cores: set[int]) -> Iterator[Service]:
    mine, files = os.sched_getaffinity(0), resource.getrlimit(resource.RLIMIT_NOFILE)
    with (folder / f"{name}.log").open("ab") as log:
        os.sched_setaffinity(0, cores)  # child processes inherit both
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(OPEN_FILES, files[1]), files[1]))
        try:
            environment = os.environ | {
                "TIGAS_DASH_ENCODER": "libx264",
                "TIGAS_STORE_MOVEMENTS": str(folder / "models"),
            }
            process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True, env=environment)
        finally:
            os.sched_setaffinity(0, mine)
            resource.setrlimit(resource.RLIMIT_NOFILE, files)
        try:
            yield Service(name, process)
        finally:
            end(process, 10)


def _healthy(service: Service, port: int) -> None:
    """Wait until a service answers. Raises RuntimeError if it ends instead."""
    late = time.monotonic() + START_S
    while service.runs and time.monotonic() < late:
        try:
            if httpx.get(f"http://127.0.0.1:{port}/healthz", trust_env=False).is_success:
                return
        except httpx.HTTPError:
            time.sleep(0.2)
    raise RuntimeError(f"tigas {service.name} does not start.")


def isolate(command: list[str]) -> None:
    """Restart in a new network namespace, where the shaper can shape and all ports are free; needs root."""
    os.execvp("unshare", ["unshare", "--net", "--", *command])


def plug_in() -> None:
    """The interfaces of a new network namespace."""
    for line in (
        "link set lo up",
        "link add access type veth peer name access-end",
        "link add service type veth peer name service-end",
        f"address add {ACCESS} dev access",
        f"address add {SERVICE} dev service",
        *(f"link set {name} up" for name in ("access", "access-end", "service", "service-end")),
    ):
        subprocess.run(["ip", *line.split()], check=True)
