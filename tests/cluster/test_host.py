"""A host of a cluster, and the connection to Ray."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import psutil
import pytest

from tests.command import tigas
from tests.eventually import wait_until
from tigas_cluster import host as module
from tigas_cluster.connection import AlreadyManaged, PrivateRay, configured_address
from tigas_cluster.host import Host
from tigas_common.errors import StartError
from tigas_common.installation import install_command

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
    wait_until(lambda: host.facts()["url"] is not None)
    url = host.facts()["url"]
    assert url
    return url


@pytest.mark.slow
def test_says_where_it_is_and_starts_its_service_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where there are no models
    monkeypatch.setenv("TIGAS_VIEWER_ADDRESS", "host.example.org")
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
        wait_until(lambda: host.facts()["url"] not in (None, url))
        again = service()
        assert httpx.get(f"{url_of(host)}/healthz").status_code == 200
    assert not again.is_running()


@pytest.mark.slow
def test_says_why_it_cannot_serve_and_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.05)
    with running("--scenes", "/nowhere") as host:
        wait_until(lambda: host.facts()["failure"] is not None)
        assert str(host.facts()["failure"]).startswith("The models directory /nowhere does not exist")
        assert host.facts()["url"] is None
        wait_until(lambda: psutil.Process().children() != [])


@pytest.mark.slow
def test_its_service_ends_with_it_if_it_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert any(line.startswith("Open ") for line in process.stdout)
        [service] = psutil.Process(process.pid).children()
        process.send_signal(signal.SIGKILL)
    service.wait(10)


def test_without_an_address_there_is_none_to_join(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAY_ADDRESS", "")
    assert configured_address() is None


def test_a_head_that_listens_is_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as head:
        address = f"127.0.0.1:{head.getsockname()[1]}"
        monkeypatch.setenv("RAY_ADDRESS", address)
        assert configured_address() == address
    with pytest.raises(StartError, match=rf"^The Ray cluster at {address} cannot be reached \(Connection refused\)\.$"):
        configured_address()


@pytest.mark.parametrize("address", ["ray://10.0.0.1:10001", "local", "10.0.0.1", "10.0.0.1:99999"])
def test_what_is_no_head_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    monkeypatch.setenv("RAY_ADDRESS", address)
    with pytest.raises(StartError, match=r"^RAY_ADDRESS must be the head's HOST:PORT, such as 10.0.0.1:6379, not "):
        configured_address()


@pytest.mark.parametrize("command", ["up", "status"])
def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    run = tigas("cluster", command)
    assert (run.exit_code, run.stderr) == (
        1,
        f"A cluster needs Ray, which is not installed: {install_command('cluster')}\n",
    )


def test_the_status_of_no_cluster_is_a_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run = tigas("cluster", "status")
    assert run.exit_code == 1
    assert run.stderr.startswith("No cluster is running here: start one with `tigas cluster up`")


def test_what_a_ray_of_our_own_has_left_is_not_taken_for_one_that_runs(tmp_path: Path) -> None:
    own = PrivateRay(tmp_path)
    (tmp_path / "process").write_text("1")
    (tmp_path / "ray_current_cluster").write_text("127.0.0.1:1")
    assert own.find_address() is None


def test_two_that_start_a_ray_of_their_own_at_once_do_not_harm_each_other(tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    with (tmp_path / "process").open("w") as process:
        fcntl.flock(process, fcntl.LOCK_EX)  # the other one has not written its id yet
        with pytest.raises(AlreadyManaged):
            PrivateRay(tmp_path)._launch()
    assert (tmp_path / "session").is_dir()
