"""A host: a real render service, with made-up frames, that is kept running."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import psutil
import pytest

from tests.testbed.inside import wait_until
from tigas_cluster import host as module
from tigas_cluster.host import Host

PROGRAM = """
import time
from tigas_cluster.host import Host
host = Host("127.0.0.1", 0, 0, ["--device", "instant"])
time.sleep(60)
"""


@contextlib.contextmanager
def running(*options: str) -> Iterator[Host]:
    host = Host("127.0.0.1", 0, 0, options)
    try:
        yield host
    finally:
        host.stop()


def service() -> psutil.Process:
    """The render service, which is a child of this process."""
    [found] = [each for each in psutil.Process().children() if "render" in each.cmdline()]
    return found


def url_of(host: Host) -> str:
    wait_until(lambda: host.facts()["url"] is not None, 30)
    url = host.facts()["url"]
    assert url
    return url


@pytest.mark.slow
def test_says_where_it_is_and_starts_its_service_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where there are no models
    monkeypatch.setenv("TIGAS_CLUSTER_VIEWER_ADDRESS", "host.example.org")
    with running("--device", "instant") as host:
        url = url_of(host)
        assert httpx.get(f"{url}/api/load", headers={"Host": "host.example.org"}).status_code == 200
        assert httpx.delete(f"{url}/scenes/courtyard").json()["type"] == "tigas:scenes-fixed"
        assert host.facts()["viewer_address"] == "host.example.org"
        ready, empty = host.facts()["said"]
        assert ready == "1 scene ready on instant."
        assert empty.startswith("models has no scenes yet")
        killed = service()
        killed.kill()
        wait_until(lambda: host.facts()["url"] not in (None, url), 30)
        again = service()
        assert httpx.get(f"{url_of(host)}/healthz").status_code == 200
    assert not again.is_running()


@pytest.mark.slow
def test_says_why_it_cannot_serve_and_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.05)
    with running("--scenes", "/nowhere") as host:
        wait_until(lambda: host.facts()["failure"] is not None, 30)
        assert str(host.facts()["failure"]).startswith("The models directory /nowhere does not exist")
        assert host.facts()["url"] is None
        wait_until(lambda: psutil.Process().children() != [], 30)


@pytest.mark.slow
def test_its_service_ends_with_it_if_it_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert any(line.startswith("Open ") for line in process.stdout)
        [service] = psutil.Process(process.pid).children()
        process.send_signal(signal.SIGKILL)
    service.wait(10)
