"""The network-namespace lab as fixtures, and the real `tigas shaper` in its gateway. Everything is removed here."""

from __future__ import annotations

import http.client
import itertools
import json
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from tests.eventually import wait_until
from tests.prerequisites import NAMESPACES
from tests.testbed.inside import inside
from tigas_common.errors import StartError
from tigas_common.topology import PAGE_ORIGINS, SHAPER
from tigas_common.wire.shaper import ShaperStatus
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.trace import NetworkTrace
from tigas_testbed.namespaces import GATEWAY_ADDRESS, Lab
from tigas_testbed.services import PORTS, Runner
from tigas_testbed.user import User

ORIGIN = PAGE_ORIGINS[0]
NOBODY = User(65534, 65534)
"""User of the tests' services, whoever runs the tests."""
_numbers = itertools.count()
_TESTS_CLIENT = re.compile(r"^tigas-(t\d+n\d+)-client\b", re.MULTILINE)


def new_lab() -> Lab:
    return Lab(f"t{os.getpid()}n{next(_numbers)}")


def remove_abandoned() -> None:
    """Remove the labs of tests that have ended."""
    namespaces = subprocess.run(("ip", "netns", "list"), check=True, capture_output=True, text=True).stdout
    for name in _TESTS_CLIENT.findall(namespaces):
        with suppress(StartError), Lab(name).up():  # removes leftovers, unless they are in use
            pass


class ShaperProcess:
    def __init__(self, lab: Lab, process: subprocess.Popen[str]) -> None:
        self.lab = lab
        self.process = process

    def request(
        self, method: str, path: str, body: bytes | None = None, origin: str | None = ORIGIN
    ) -> tuple[int, Any]:
        """Status and JSON of one request, from the client's namespace."""
        with inside(self.lab, "client"):
            connection = http.client.HTTPConnection(GATEWAY_ADDRESS, SHAPER.number, timeout=5)
            connection.connect()
        try:
            connection.request(method, path, body, {"Origin": origin} if origin else {})
            response = connection.getresponse()
            return response.status, json.loads(response.read())
        finally:
            connection.close()

    def post(self, path: str, **body: Any) -> ShaperStatus:
        """Change something, and return the new status."""
        status, answer = self.request("POST", path, json.dumps(body).encode())
        assert status == 200, answer
        return ShaperStatus.model_validate(answer)

    def play(self, trace: NetworkTrace, *, loop: bool = False) -> float:
        """Play a trace, and return when it started (s, of time.monotonic)."""
        status, answer = self.request("POST", f"/traces?name={trace.name}", format_csv(trace).encode())
        assert status == 200, answer
        playing = self.post("/start", trace=trace.name, loop=loop)
        assert playing.position_ms is not None
        return (playing.time_ms - playing.position_ms) / 1e3

    def status(self) -> ShaperStatus:
        status, answer = self.request("GET", "/status")
        assert status == 200
        return ShaperStatus.model_validate(answer)

    def is_up(self) -> bool:
        assert self.process.poll() is None, f"the shaper ended:\n{self.output()}"
        with suppress(OSError):
            return self.request("GET", "/healthz")[0] in (200, 503)
        return False

    def output(self) -> str:
        assert self.process.stdout
        return self.process.stdout.read()


@contextmanager
def shaper(lab: Lab, *more: str) -> Iterator[ShaperProcess]:
    """A running shaper, as a context manager."""
    with subprocess.Popen(
        Runner(lab, NOBODY).shaper(*more), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        running = ShaperProcess(lab, process)
        try:
            wait_until(running.is_up)
            yield running
        finally:
            process.terminate()


def left_behind(lab: Lab) -> list[str]:
    """Leftovers of shaping in the gateway's namespace."""
    found = []
    for argv, sign in ((("tc", "qdisc"), "htb"), (("tc", "qdisc"), "clsact"), (("nft", "list", "tables"), "tigas"),
                       (("ip", "-br", "link"), "tigas-")):  # fmt: skip
        output = subprocess.run(lab.command("gateway", argv), check=True, capture_output=True, text=True).stdout
        found += [line for line in output.splitlines() if sign in line]
    return found


def ip_forward(lab: Lab) -> str:
    argv = lab.command("gateway", ["cat", "/proc/sys/net/ipv4/ip_forward"])
    return subprocess.run(argv, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture(scope="session", autouse=True)
def can_make_labs() -> None:
    """Require network namespaces, and remove the labs of killed test runs."""
    NAMESPACES.require()
    remove_abandoned()


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """A lab for the tests of one file."""
    with new_lab().up(PORTS) as made:
        yield made


@pytest.fixture(scope="module")
def link(lab: Lab) -> Iterator[ShaperProcess]:
    with shaper(lab) as running:
        yield running


@pytest.fixture
def own_lab() -> Iterator[Lab]:
    """A lab for one test, which may break it."""
    with new_lab().up(PORTS) as made:
        yield made
