"""Services that runs are made against: whether they live, and are the ones that they were."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import httpx
import psutil
import pytest

from tests.experiments.made_up import SERVER
from tests.scenes import scene
from tigas_common.errors import StartError
from tigas_common.render_requests import RenderClient
from tigas_common.wire.render import SceneDownload, SceneInfo
from tigas_experiments.run.targets import Target, find_fault, load_scene, read_config, url_target
from tigas_experiments.run.watched import find_watched, is_local, process_name


class Services:
    """A render service and a shaper with answers chosen by the test."""

    url = "http://lab:8080"

    def __init__(self) -> None:
        self.certificate = "one"
        self.retry_after_s: float | None = None
        self.free_bytes: int | None = None
        self.shaper_status = 200
        self.stopped = False
        self.asked: list[str] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        if self.stopped:
            raise httpx.ConnectError("Connection refused")
        if request.method == "POST":
            self.asked.append(request.url.raw_path.decode())
            return httpx.Response(404)
        if request.url.path.startswith("/shaper"):
            return httpx.Response(self.shaper_status)
        services = {"shaper": f"{self.url}/shaper"}
        config = SERVER.model_copy(
            update={
                "certificate_sha256": self.certificate,
                "services": services,
                "retry_after_s": self.retry_after_s,
                "max_upload_bytes": self.free_bytes,
            }
        )
        return httpx.Response(200, content=config.model_dump_json())


@pytest.fixture
def services(monkeypatch: pytest.MonkeyPatch) -> Services:
    made = Services()
    monkeypatch.setattr(httpx, "AsyncClient", partial(httpx.AsyncClient, transport=httpx.MockTransport(made)))
    return made


def test_a_fault_of_the_services_is_named(services: Services) -> None:
    target = Target(services.url, asyncio.run(read_config(services.url)))
    assert asyncio.run(find_fault(target)) is None
    services.retry_after_s = 5.0
    assert asyncio.run(find_fault(target)) is None, "it is only full"
    services.free_bytes = 1 << 20
    assert asyncio.run(find_fault(target)) is None, "its disk is only fuller"
    services.shaper_status = 503
    assert asyncio.run(find_fault(target)) == f"{services.url}/shaper did not answer, or does not work."
    services.shaper_status = 200
    services.certificate = "another"
    assert asyncio.run(find_fault(target)) == "The render service was restarted or changed: certificate_sha256."
    services.stopped = True
    assert asyncio.run(find_fault(target)) == f"No TIGAS render service answers at {services.url}."


def test_a_lab_s_service_that_was_started_again_is_another_one(services: Services) -> None:
    lab = subprocess.Popen([sys.executable, "-c", LAB], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert lab.stdin
    assert lab.stdout
    with lab:
        lab.stdout.readline()
        keeper = psutil.Process(lab.pid)
        config = asyncio.run(read_config(services.url))
        target = Target(services.url, config, keeper, frozenset(keeper.children()))
        assert asyncio.run(find_fault(target)) is None
        [service] = target.processes
        lab.stdin.write(b"again\n")
        lab.stdin.flush()
        lab.stdout.readline()
        assert asyncio.run(find_fault(target)) == f"A service of the lab has ended: process {service.pid}."
        lab.stdin.close()


LAB = """
import subprocess, sys
while True:
    service = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
    print(flush=True)
    again = sys.stdin.readline()
    service.kill()
    service.wait()
    if not again:
        break
"""
"""Has one service, which it kills and starts again for each line that it is given."""


def test_a_scene_s_name_stays_a_name(services: Services) -> None:
    with pytest.raises(StartError, match="cannot be loaded"):
        asyncio.run(load_scene(services.url, "../config.json?"))
    assert services.asked == ["/scenes/..%2Fconfig.json%3F/load"]


def test_what_can_be_downloaded_is_made_for_who_asks_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = scene(downloads=(SceneDownload(),))
    made: list[str] = []

    async def load(_: RenderClient, scene: str) -> SceneInfo:
        return offered

    async def prepare(_: RenderClient, scene: str) -> None:
        made.append(scene)

    monkeypatch.setattr(RenderClient, "load", load)
    monkeypatch.setattr(RenderClient, "prepare_download", prepare)
    for download, expected in ((False, []), (True, ["s"])):
        assert asyncio.run(load_scene("http://127.0.0.1:9", "s", download=download)) == offered
        assert made == expected


@pytest.mark.parametrize("url", ["", "localhost:8080", "ftp://localhost", "http://"])
def test_what_is_no_url(url: str) -> None:
    async def open_it() -> None:
        async with url_target(url):
            pass

    with pytest.raises(StartError, match="is not the URL of a viewer"):
        asyncio.run(open_it())


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
    watch = find_watched(target(url))
    [edge] = process.children()
    assert watch.services == "threads"
    assert watch.processes == {process: "tigas render", edge: "tigas edge"}, "also processes that do not listen"


def test_the_browser_is_watched_as_a_child_of_the_experiment(service: tuple[psutil.Process, str]) -> None:
    watch = find_watched(target(ELSEWHERE))
    assert watch.services == "elsewhere"
    assert service[0] in watch.processes


@pytest.mark.usefixtures("no_children")
def test_one_service_on_another_machine_is_told(service: tuple[psutil.Process, str]) -> None:
    watch = find_watched(target(service[1], dash=ELSEWHERE))
    assert watch.services == "elsewhere"
    assert service[0] in watch.processes


@pytest.mark.usefixtures("no_children")
def test_what_listens_and_is_none_of_our_services_is_not_watched(service: tuple[psutil.Process, str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as proxy:
        port = proxy.getsockname()[1]
        watch = find_watched(target(service[1], dash=f"http://127.0.0.1:{port}"))
    assert watch.services == "processors"
    assert psutil.Process() not in watch.processes


def test_all_of_a_lab_are_children(service: tuple[psutil.Process, str]) -> None:
    watch = find_watched(Target("http://127.0.0.1:9", SERVER, lab=service[0]))
    assert watch.services == "threads"
    assert watch.processes[service[0]] == "tigas render"


def test_which_hosts_are_this_machine() -> None:
    own = [each.address for card in psutil.net_if_addrs().values() for each in card if each.family == socket.AF_INET]
    for host in ("localhost", "127.0.0.1", "[::1]", *own):
        assert is_local(f"http://{host}:8080"), host
    assert not is_local(ELSEWHERE)


def test_a_name_that_leads_nowhere_is_not_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object) -> None:
        raise socket.gaierror

    monkeypatch.setattr(socket, "getaddrinfo", lost)
    assert not is_local("http://tigas.invalid")


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
