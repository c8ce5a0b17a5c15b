"""Services that runs are made against: whether they live, and are the ones that they were."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import psutil
import pytest

from tigas_common.errors import StartError
from tigas_experiments.run.targets import Target, alive, load_scene, make_download, read_config, url_target


class Services:
    """A render service and a shaper with answers chosen by the test."""

    def __init__(self) -> None:
        self.certificate = "one"
        self.shaper_status = 200
        self.asked: list[str] = []
        services = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self._answer(services.shaper_status if self.path.startswith("/shaper") else 200)

            def do_POST(self) -> None:
                services.asked.append(self.path)
                self._answer(404)

            def _answer(self, status: int) -> None:
                body = json.dumps(services.config if self.path == "/config.json" else {}).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"

    @property
    def config(self) -> dict[str, object]:
        return {
            "version": "1",
            "ladder": [],
            "certificate_sha256": self.certificate,
            "webtransport_url": None,
            "https_url": None,
            "services": {"shaper": f"{self.url}/shaper"},
        }

    def stop(self) -> None:
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def services() -> Iterator[Services]:
    """Started."""
    made = Services()
    thread = threading.Thread(target=made.server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield made
    made.stop()
    thread.join()


def test_services_that_are_what_they_were_live(services: Services) -> None:
    target = Target(services.url, asyncio.run(read_config(services.url)))
    assert asyncio.run(alive(target))
    services.shaper_status = 503
    assert not asyncio.run(alive(target)), "its link is closed"
    services.shaper_status = 200
    services.certificate = "another"
    assert not asyncio.run(alive(target)), "it was started again"
    services.stop()
    assert not asyncio.run(alive(target)), "it was killed"


def test_a_lab_s_service_that_was_started_again_is_another_one(services: Services) -> None:
    lab = subprocess.Popen([sys.executable, "-c", LAB], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert lab.stdin
    assert lab.stdout
    with lab:
        lab.stdout.readline()
        keeper = psutil.Process(lab.pid)
        config = asyncio.run(read_config(services.url))
        target = Target(services.url, config, keeper, frozenset(keeper.children()))
        assert asyncio.run(alive(target))
        lab.stdin.write(b"again\n")
        lab.stdin.flush()
        lab.stdout.readline()
        assert not asyncio.run(alive(target))
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


def test_a_download_that_cannot_be_made_is_told_in_a_sentence(services: Services) -> None:
    asyncio.run(make_download(services.url, "garden"))
    services.stop()
    with pytest.raises(StartError, match=r"^The scene 'garden' cannot be loaded from http"):
        asyncio.run(make_download(services.url, "garden"))


@pytest.mark.parametrize("url", ["", "localhost:8080", "ftp://localhost", "http://"])
def test_what_is_no_url(url: str) -> None:
    async def open_it() -> None:
        async with url_target(url):
            pass

    with pytest.raises(StartError, match="is no URL of a viewer"):
        asyncio.run(open_it())
