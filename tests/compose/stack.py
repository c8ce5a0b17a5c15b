"""The containers under test: `docker compose` with a separate project, always taken down."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal

from tigas_common.pose import Intrinsics, Pose
from tigas_common.topology import PAGE, PAGE_ORIGINS, SHAPER, STORE, Port
from tigas_common.wire.render import RenderRequest

ROOT = Path(__file__).parents[2]
SERVICES = ("render", "dash-packager", "store", "shaper")
Service = Literal["render", "dash-packager", "store", "shaper"]
Machine = Literal["head", "host-1", "host-2"]
MACHINES: tuple[Machine, ...] = ("head", "host-1", "host-2")


class Stack:
    """Containers that run. Published ports are reached at localhost, as a user's are."""

    def __init__(self, models: Path, *, file: str = "compose.yaml", **environment: str) -> None:
        """models: the scenes; file: of Compose; environment: its variables."""
        self._options = ("--file", file, "--project-name", f"{file.removesuffix('.yaml').replace('.', '-')}-test")
        self._environment = {**os.environ, "TIGAS_MODELS": str(models), **environment}

    def compose(self, *arguments: str) -> str:
        """Run `docker compose` and return its output. Raises AssertionError with the output on failure."""
        argv = ("docker", "compose", "--progress", "quiet", *self._options, *arguments)
        done = subprocess.run(argv, cwd=ROOT, env=self._environment, capture_output=True, text=True)
        assert done.returncode == 0, f"{' '.join(argv)}: {done.stderr}"
        return done.stdout

    @contextmanager
    def running(self) -> Iterator[None]:
        """Everything that an earlier run left is removed before, and everything of this one after."""
        self.down()
        try:
            self.up("--build")
            yield
        finally:
            self.down()

    def up(self, *options: str) -> None:
        """Start stopped services, and wait until they are healthy."""
        try:
            self.compose("up", "--detach", "--wait", *options)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.compose('logs', '--tail', '30')}") from None

    def down(self) -> None:
        """Remove containers, networks, volumes and this project's names of the images."""
        self.compose("down", "--volumes", "--remove-orphans", "--rmi", "local", "--timeout", "3")

    def container(self, service: Service | Machine) -> str:
        """The id of a service's container."""
        return self.compose("ps", "--all", "--quiet", service).strip()

    def inspect(self, service: Service | Machine) -> dict[str, Any]:
        """Docker's description of a container."""
        found: list[dict[str, Any]] = json.loads(docker("inspect", self.container(service)))
        return found[0]

    def inside(self, service: Service | Machine, script: str) -> str:
        """Run a shell script in a container; its output, errors among it."""
        return self.compose("exec", "-T", service, "sh", "-c", f"{script} 2>&1 || true")

    def set_link(self, **link: float) -> None:
        """Keep one state of the link."""
        ask(SHAPER, "POST", "/link", link)

    def status(self) -> dict[str, Any]:
        """The shaper's status."""
        status: dict[str, Any] = ask(SHAPER, "GET", "/status")
        return status


def connected(port: Port, timeout_s: float) -> closing[http.client.HTTPConnection]:
    """A connection to a published port, as a context manager."""
    return closing(http.client.HTTPConnection("localhost", port.number, timeout=timeout_s))


def ask(port: Port, method: str, path: str, body: object = None) -> Any:
    """Request a service like the page; returns its answer, parsed if it is JSON."""
    with connected(port, 60) as connection:  # a report takes seconds, and longer on a busy machine
        connection.request(method, path, None if body is None else json.dumps(body), {"Origin": PAGE_ORIGINS[0]})
        answer = connection.getresponse()
        data = answer.read()
    assert answer.status in (200, 201, 204), data
    return json.loads(data) if "json" in answer.headers.get("Content-Type", "") else data


def store(method: str, path: str, body: object = None) -> Any:
    """Ask the experiments' store."""
    return ask(STORE, method, path, body)


def docker(*arguments: str) -> str:
    """Run `docker`; its output."""
    return subprocess.run(("docker", *arguments), check=True, capture_output=True, text=True).stdout


def answers() -> bool:
    """Whether the render service answers through the gateway."""
    try:
        with connected(PAGE, 1) as connection:
            connection.request("GET", "/healthz")
            return connection.getresponse().status == 200
    except (OSError, http.client.HTTPException):
        return False


def round_trips_ms(count: int) -> list[float]:
    """How long small requests take on one connection."""
    times = []
    with connected(PAGE, 5) as connection:
        for _ in range(count + 1):
            before = time.monotonic()
            connection.request("GET", "/healthz")
            connection.getresponse().read()
            times.append((time.monotonic() - before) * 1e3)
    return times[1:]  # the first one opened the connection


def download_kbps(scene: str, width: int, height: int) -> float:
    """Throughput of an uncompressed frame, from its first to its last byte: without the rendering time, and without
    bytes held up behind a lost packet, which would make the link look faster.
    """
    lens = Intrinsics(width, width, width / 2, height / 2, width, height)
    request = RenderRequest.at(scene, Pose.from_euler(0, 0, 0, (0, 0, 0)), lens, format="yuv420p")
    with connected(PAGE, 60) as connection:
        connection.request("POST", "/render", request.model_dump_json(exclude_none=True))
        answer = connection.getresponse()
        assert answer.status == 200, answer.read()
        size = int(answer.headers["Content-Length"])
        assert size == width * height * 3 // 2
        answer.read(1)
        start = time.monotonic()
        answer.read()
        elapsed = time.monotonic() - start
    return size * 8e-3 / elapsed
