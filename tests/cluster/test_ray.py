"""`tigas cluster` over a real Ray: two machines, simulated as two of its nodes, or a private Ray."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil
import pytest

from tests.eventually import wait_until
from tigas_cluster.connection import PrivateRay
from tigas_common.processes import tigas_command

pytestmark = [pytest.mark.slow, pytest.mark.extended]
START_RAY = (sys.executable, "-m", "ray.scripts.scripts", "start", "--block")
A_HOST = {"TIGAS_CLUSTER_RESOURCE": "a_host"}
NODE = ("--num-cpus=1", "--object-store-memory=80000000", '--resources={"a_host": 1}')
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_GRACEFUL_SHUTDOWN_DRAIN_TIMEOUT_S": "0",
    "RAY_memory_monitor_refresh_ms": "0",
}


@pytest.fixture
def folder() -> Iterator[Path]:
    with short_folder() as folder:
        yield folder
        PrivateRay(folder / f"tigas-ray-{os.getuid()}").stop()  # of a test that has failed


@contextlib.contextmanager
def short_folder() -> Iterator[Path]:
    """With a short name, since Unix sockets below it have long ones."""
    with tempfile.TemporaryDirectory(prefix="t", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@dataclass
class Machines:
    address: str
    head: subprocess.Popen[bytes]
    other: subprocess.Popen[bytes]

    @property
    def environment(self) -> dict[str, str]:
        return {"RAY_ADDRESS": self.address}


@pytest.fixture(scope="module")
def machines() -> Iterator[Machines]:
    with contextlib.ExitStack() as stack:
        ray = stack.enter_context(short_folder())
        address = ray / "ray_current_cluster"
        head = ("--head", "--port=0", f"--temp-dir={ray}", "--include-dashboard=false", "--no-monitor")
        first = stack.enter_context(running([*START_RAY, *NODE, *head]))
        wait_until(address.exists)
        second = stack.enter_context(running([*START_RAY, *NODE, f"--address={address.read_text()}"]))
        yield Machines(address.read_text(), first, second)


@contextlib.contextmanager
def running(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """A part of Ray, which has ended with all that it started when the context ends."""
    environment = os.environ | QUIET
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True) as process:
        started = psutil.Process(process.pid)
        try:
            yield process
        finally:
            left = descendants(started)
            process.terminate()
            process.wait(20)
            wait_until(lambda: not any(map(is_alive, left)))


@dataclass
class Up:
    """`tigas cluster up`."""

    process: subprocess.Popen[str]
    url: str
    environment: dict[str, str]

    def status(self) -> list[dict[str, Any]]:
        command = tigas_command("cluster", "status", "--json")
        found: list[dict[str, Any]] = json.loads(subprocess.check_output(command, env=self.environment))
        return found

    def hosts(self) -> set[str]:
        """Hosts that are up according to the director."""
        metrics = httpx.get(f"{self.url}/metrics").text
        return set(re.findall(r'^tigas_director_viewers\{host="([^"]+)"\}', metrics, flags=re.MULTILINE))

    def place(self, **about: str) -> dict[str, Any]:
        answer = httpx.get(f"{self.url}/config.json", params={"scene": "courtyard", **about})
        found: dict[str, Any] = answer.raise_for_status().json()
        return found

    def interrupt(self) -> None:
        """Press Ctrl+C; it ends in order, and has not given up Ray after `up.STOP_TIMEOUT_S`."""
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30) == 0


@contextlib.contextmanager
def up(environment: dict[str, str], *options: str) -> Iterator[Up]:
    """A running one, until the context ends."""
    environment = {**{name: value for name, value in os.environ.items() if name != "RAY_ADDRESS"}, **environment}
    command = tigas_command("cluster", "up", "--http", "127.0.0.1:0", *options, "--", "--device", "instant")
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            lines = []
            for line in process.stdout:
                lines.append(line)
                if opened := re.match(r"Open (http://\S+)/", line):
                    break
            assert opened, lines
            yield Up(process, opened[1], environment)
        finally:
            process.kill()


def descendants(process: psutil.Process) -> list[psutil.Process]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.children(recursive=True)
    return []


def named(process: subprocess.Popen[bytes], words: str) -> psutil.Process | None:
    """The descendant with these words in its command line."""
    for each in descendants(psutil.Process(process.pid)):
        with contextlib.suppress(psutil.NoSuchProcess):
            if words in " ".join(each.cmdline()):
                return each
    return None


def service(machine: subprocess.Popen[bytes]) -> psutil.Process:
    found = named(machine, "tigas_common render")
    assert found
    return found


def host_on(machine: subprocess.Popen[bytes], cluster: Up) -> str:
    """The name of the host that a machine is."""
    ports = {each.laddr.port for each in service(machine).net_connections("tcp") if each.status == psutil.CONN_LISTEN}
    [name] = [each["host"] for each in cluster.status() if urlsplit(each["url"]).port in ports]
    return str(name)


@pytest.mark.timeout(300)
def test_hosts_outlive_a_second_up_and_a_killed_one_and_the_next_finds_them_and_ends_all(folder: Path) -> None:
    environment = {"TMPDIR": str(folder)}
    with up(environment) as cluster:
        [host] = cluster.status()
        assert (host["host"], host["viewers"], host["failure"]) == ("host-1", 0, None)
        second = subprocess.run(
            tigas_command("cluster", "up", "--http=127.0.0.1:0"),
            env=cluster.environment,
            capture_output=True,
            text=True,
        )
        assert second.returncode == 1
        assert second.stderr.endswith("Another `tigas cluster up` manages this cluster; stop it first.\n")
        assert [each["since"] for each in cluster.status()] == [host["since"]]
        cluster.process.kill()
        cluster.process.wait()
    assert httpx.get(f"{host['url']}/healthz").status_code == 200
    with up(environment) as cluster:
        assert cluster.place()["render_url"] == host["url"]
        assert cluster.status()[0]["since"] == host["since"]
        of_ray = [each for each in psutil.process_iter() if is_about(each, folder)]
        assert len(of_ray) > 2
        cluster.interrupt()
    assert [each for each in of_ray if is_alive(each)] == []
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{host['url']}/healthz")
    assert list(folder.iterdir()) == []


@pytest.mark.timeout(300)
def test_a_host_or_a_machine_is_killed_and_the_others_serve(machines: Machines) -> None:
    with up(machines.environment | A_HOST, "--hosts=2") as cluster:
        wait_until(lambda: cluster.hosts() == {"host-1", "host-2"})
        name, render = host_on(machines.other, cluster), service(machines.other)
        actor = named(machines.other, "ray::Host")
        assert actor
        actor.kill()
        # Its service lives slightly longer, and viewers stay with a host that answers.
        wait_until(lambda: cluster.place(silent=name)["host"] != name)
        render.wait(30)
        wait_until(lambda: cluster.hosts() == {"host-1", "host-2"}, 60)

        render, left = service(machines.other), service(machines.head)
        os.killpg(machines.other.pid, signal.SIGKILL)
        wait_until(lambda: cluster.hosts() == {host_on(machines.head, cluster)})
        render.wait(10)
        cluster.interrupt()
        assert not is_alive(left)
        assert machines.head.poll() is None


def is_alive(process: psutil.Process) -> bool:
    """Whether it is running, and not a zombie of a dead parent."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return process.status() != psutil.STATUS_ZOMBIE
    return False


def is_about(process: psutil.Process, folder: Path) -> bool:
    """Whether a process' environment names this folder."""
    with contextlib.suppress(psutil.Error):
        return str(folder) in " ".join(process.cmdline())
    return False
