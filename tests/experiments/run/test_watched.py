"""Processes watched during a run, and their names."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.experiments.made_up import SERVER
from tigas_experiments.run.targets import Target
from tigas_experiments.run.watched import is_here, process_name, watched

ELSEWHERE = "http://192.0.2.1:8080"
"""No machine's address (RFC 5737)."""
SERVICE = """
import socket, subprocess, sys
if sys.argv[1] == "edge":
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        input()
else:
    subprocess.run([sys.executable, sys.argv[0], "edge"])
"""


def target(url: str, **services: str) -> Target:
    return Target(url, SERVER.model_copy(update={"services": services}))


@pytest.fixture
def service(tmp_path: Path) -> Iterator[tuple[psutil.Process, str]]:
    """Something that is started as our command is, and its URL."""
    (script := tmp_path / "tigas").write_text(SERVICE)
    with subprocess.Popen(
        [sys.executable, script, "render"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield psutil.Process(process.pid), f"http://127.0.0.1:{int(process.stdout.readline())}"
        process.communicate("\n")


@pytest.fixture
def no_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if another user had started the services."""
    own = psutil.Process.children

    def children(process: psutil.Process, recursive: bool = False) -> list[psutil.Process]:
        return [] if process.pid == os.getpid() else own(process, recursive=recursive)

    monkeypatch.setattr(psutil.Process, "children", children)


@pytest.mark.usefixtures("no_children")
def test_a_service_on_this_machine_is_watched_with_all_of_its_processes(service: tuple[psutil.Process, str]) -> None:
    process, url = service
    watch = watched(target(url))
    [edge] = process.children()
    assert watch.services == "threads"
    assert watch.processes == {process: "tigas render", edge: "tigas edge"}, "also what does not listen itself"


def test_the_browser_is_watched_as_a_child_of_the_experiment(service: tuple[psutil.Process, str]) -> None:
    watch = watched(target(ELSEWHERE))
    assert watch.services == "elsewhere"
    assert service[0] in watch.processes


@pytest.mark.usefixtures("no_children")
def test_one_service_on_another_machine_is_told(service: tuple[psutil.Process, str]) -> None:
    watch = watched(target(service[1], dash=ELSEWHERE))
    assert watch.services == "elsewhere"
    assert service[0] in watch.processes


@pytest.mark.usefixtures("no_children")
def test_what_listens_and_is_none_of_our_services_is_not_watched(service: tuple[psutil.Process, str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as proxy:
        port = proxy.getsockname()[1]
        watch = watched(target(service[1], dash=f"http://127.0.0.1:{port}"))
    assert watch.services == "processors"
    assert psutil.Process() not in watch.processes


def test_all_of_a_lab_are_children(service: tuple[psutil.Process, str]) -> None:
    watch = watched(Target("http://127.0.0.1:9", SERVER, lab=service[0]))
    assert watch.services == "threads"
    assert watch.processes[service[0]] == "tigas render"


def test_which_hosts_are_this_machine() -> None:
    own = [each.address for card in psutil.net_if_addrs().values() for each in card if each.family == socket.AF_INET]
    for host in ("localhost", "127.0.0.1", "[::1]", *own):
        assert is_here(f"http://{host}:8080"), host
    assert not is_here(ELSEWHERE)


def test_a_name_that_leads_nowhere_is_not_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object) -> None:
        raise socket.gaierror

    monkeypatch.setattr(socket, "getaddrinfo", lost)
    assert not is_here("http://tigas.invalid")


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["/usr/bin/python3", "/opt/bin/tigas", "render", "--edges", "2"], "tigas render"),
        (["python3", "-m", "tigas_common", "dash"], "tigas dash"),
        (["python3", "-P", "-m", "tigas_render.workers.edge", "5"], "tigas_render.workers.edge"),
        (["/usr/lib/chromium/chromium", "--headless"], "python3"),
        (["/usr/lib/chromium/chromium", "--no-sandbox", "--type=renderer"], "python3 renderer"),
        (["python3", "other.py", "a", "b", "tigas", "c"], "python3"),
        (["tigas"], "python3"),
        ([], "python3"),
    ],
)
def test_what_a_process_is_called(command: list[str], name: str) -> None:
    assert process_name("python3", command) == name
