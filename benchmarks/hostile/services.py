"""The real services on loopback, each in its own process, over a scene small enough for one core."""

from __future__ import annotations

import json
import os
import resource
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np

from benchmarks.services import Service, free_ports, started
from reference.ply import write_ply
from tigas_render.gaussians import Gaussians

Name = Literal["render", "dash", "store", "shaper"]
GAUSSIANS = 5_000
SCENE = "ball"
OPEN_FILES = 1024
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
        return cls(*free_ports(socket.SOCK_DGRAM, *[socket.SOCK_STREAM] * 4))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the output of `str`."""
        return cls(**json.loads(text))

    def __str__(self) -> str:
        return json.dumps(asdict(self))


@contextmanager
def running(
    wanted: Sequence[Name], ports: Ports, folder: Path, cores: set[int], device: str
) -> Iterator[dict[Name, Service]]:
    """Run the render service on a device, and the other wanted services, on these cores, as a context manager."""
    write_scene(folder / "models" / SCENE / f"{SCENE}.ply")
    arguments = _arguments(ports, folder, device)
    variables = {
        "TIGAS_DASH_ENCODER": "libx264",
        "TIGAS_STORE_MOVEMENTS": str(folder / "models"),
        "TIGAS_STORE_RENDER": f"http://127.0.0.1:{ports.render}",
    }
    with ExitStack() as stack:
        services = {}
        with _restricted(cores):
            for name in wanted:
                service = started(name, *arguments[name], log=folder / f"{name}.log", **variables)
                services[name] = stack.enter_context(service)
        for name in wanted:
            services[name].wait_until_healthy(getattr(ports, name))
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


def _arguments(ports: Ports, folder: Path, device: str) -> dict[Name, tuple[str, ...]]:
    def listens(port: int) -> tuple[str, str]:
        return "--http", f"127.0.0.1:{port}"

    models, results = str(folder / "models"), str(folder / "results")
    return {
        "render": ("--scenes", models, "--device", device, "--quic", f"127.0.0.1:{ports.quic}", *listens(ports.render)),
        "dash": ("--render", f"http://127.0.0.1:{ports.render}", *listens(ports.dash)),
        "store": ("--results", results, *listens(ports.store)),
        "shaper": ("--access", "access", "--service", "service", "--forward", "tcp:8080=10.9.2.2:8080",
                   *listens(ports.shaper)),
    }  # fmt: skip


@contextmanager
def _restricted(cores: set[int]) -> Iterator[None]:
    """Processes that are started meanwhile have these cores, and as few open files as most systems allow."""
    mine, files = os.sched_getaffinity(0), resource.getrlimit(resource.RLIMIT_NOFILE)
    os.sched_setaffinity(0, cores)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(OPEN_FILES, files[1]), files[1]))
    try:
        yield
    finally:
        os.sched_setaffinity(0, mine)
        resource.setrlimit(resource.RLIMIT_NOFILE, files)


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
