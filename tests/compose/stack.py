"""The containers as tests drive them: `docker compose` with a project of its own, always taken down."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

ROOT = Path(__file__).parents[2]
PROJECT = "tigas-test"
ORIGIN = "http://localhost:8080"
SERVICES = ("render", "dash-packager", "store", "shaper")
Service = Literal["render", "dash-packager", "store", "shaper"]


class Stack:
    """Containers that run. Published ports are reached at localhost, as a user's are."""

    def __init__(self, models: Path) -> None:
        self._environment = {**os.environ, "TIGAS_MODELS": str(models)}

    def compose(self, *arguments: str) -> str:
        """Run `docker compose`; its output. An AssertionError with what it said if it fails."""
        argv = ("docker", "compose", "--progress", "quiet", "--project-name", PROJECT, *arguments)
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
        """Start what does not run, and wait until it is healthy."""
        try:
            self.compose("up", "--detach", "--wait", *options)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.compose('logs', '--tail', '30')}") from None

    def down(self) -> None:
        """Remove containers, networks, volumes and this project's names of the images."""
        self.compose("down", "--volumes", "--remove-orphans", "--rmi", "local", "--timeout", "3")

    def container(self, service: Service) -> str:
        """The id of a service's container."""
        return self.compose("ps", "--all", "--quiet", service).strip()

    def inspect(self, service: Service) -> dict[str, Any]:
        """What Docker knows of a container."""
        found: list[dict[str, Any]] = json.loads(docker("inspect", self.container(service)))
        return found[0]

    def inside(self, service: Service, script: str) -> str:
        """Run a shell script in a container; its output, errors among it."""
        return self.compose("exec", "-T", service, "sh", "-c", f"{script} 2>&1 || true")

    def set_link(self, **link: float) -> None:
        """Keep one state of the link."""
        connection = http.client.HTTPConnection("localhost", 8090, timeout=5)
        connection.request("POST", "/link", json.dumps(link), {"Origin": ORIGIN})
        answer = connection.getresponse()
        assert answer.status == 200, answer.read()
        connection.close()

    def status(self) -> dict[str, Any]:
        """The shaper's status."""
        connection = http.client.HTTPConnection("localhost", 8090, timeout=5)
        connection.request("GET", "/status")
        status: dict[str, Any] = json.loads(connection.getresponse().read())
        connection.close()
        return status


def store(method: str, path: str, body: object = None) -> Any:
    """Ask the experiments' store through the gateway, as the page does; what it answers, as far as it is JSON."""
    connection = http.client.HTTPConnection("localhost", 8091, timeout=20)
    connection.request(method, path, None if body is None else json.dumps(body), {"Origin": ORIGIN})
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    assert answer.status in (200, 201, 204), data
    return json.loads(data) if "json" in answer.headers.get("Content-Type", "") else data


def docker(*arguments: str) -> str:
    """Run `docker`; its output."""
    return subprocess.run(("docker", *arguments), check=True, capture_output=True, text=True).stdout


def answers() -> bool:
    """Whether the render service answers through the gateway."""
    connection = http.client.HTTPConnection("localhost", 8080, timeout=1)
    try:
        connection.request("GET", "/healthz")
        return connection.getresponse().status == 200
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def round_trips_ms(count: int) -> list[float]:
    """How long small requests take on one connection."""
    connection = http.client.HTTPConnection("localhost", 8080, timeout=5)
    times = []
    for _ in range(count + 1):
        before = time.monotonic()
        connection.request("GET", "/healthz")
        connection.getresponse().read()
        times.append((time.monotonic() - before) * 1e3)
    connection.close()
    return times[1:]  # the first one opened the connection


def download_kbps(scene: str, width: int, height: int) -> float:
    """The rate at which an uncompressed frame arrives, of its bytes alone, from the first to the last: rendering does
    not count, and what waited behind a lost packet cannot make it faster than the link."""
    view = {"scene": scene, "azimuth": 0, "elevation": 0, "translation": [0, 0, 0], "format": "yuv420p"}
    intrinsics = {"fx": width, "fy": width, "cx": width / 2, "cy": height / 2, "width": width, "height": height}
    connection = http.client.HTTPConnection("localhost", 8080, timeout=60)
    connection.request("POST", "/render", json.dumps(view | intrinsics))
    answer = connection.getresponse()
    assert answer.status == 200, answer.read()
    size = int(answer.headers["Content-Length"])
    assert size == width * height * 3 // 2
    answer.read(1)
    start = time.monotonic()
    answer.read()
    elapsed = time.monotonic() - start
    connection.close()
    return size * 8e-3 / elapsed
