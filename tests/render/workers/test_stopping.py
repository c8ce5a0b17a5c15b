"""A service of several processes ends at once, and leaves nothing."""

from __future__ import annotations

import asyncio
import signal
import socket
import subprocess
import sys
import time

import httpx
import psutil
import pytest

from tests.eventually import eventually
from tests.render.workers.fleet import TIGAS, Viewer, nothing_left, serving

pytestmark = pytest.mark.slow

STARTS = 20


@pytest.mark.alone
@pytest.mark.anyio
@pytest.mark.parametrize(
    ("number", "device"),
    [(signal.SIGTERM, "instant"), (signal.SIGINT, "instant,instant")],
)
async def test_all_ends_within_two_seconds_while_it_is_viewed(number: signal.Signals, device: str) -> None:
    with nothing_left(), serving(edges=2, device=device) as fleet:
        viewer = Viewer(fleet)
        watching = asyncio.create_task(viewer.watch())
        await eventually(lambda: viewer.shown)
        children = fleet.children()
        assert len(children) >= 3
        stopping = time.monotonic()
        fleet.process.send_signal(number)
        assert await asyncio.to_thread(fleet.process.wait, 10) == 0
        assert time.monotonic() - stopping < 2
        watching.cancel()
        assert not [child for child in children if child.is_running()]


def test_children_end_whose_supervisor_is_killed() -> None:
    with nothing_left(), serving(edges=2) as fleet:
        children = fleet.children()
        fleet.process.kill()
        _, alive = psutil.wait_procs(children, timeout=20)
        assert not alive


@pytest.mark.timeout(300)
@pytest.mark.extended
def test_twenty_starts_and_stops_leave_nothing() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with nothing_left():
        for start in range(STARTS):
            if start % 10 == 0:
                with serving("--http", address, edges=2) as fleet:
                    assert httpx.get(f"{fleet.url}/healthz").status_code == 200
            else:
                devices = 1 + start % 2
                device = ",".join(["instant"] * devices)
                command = (TIGAS, "render", "--edges=2", f"--device={device}", f"--http={address}", "--quic=off")
                service = psutil.Popen(command)
                while len(service.children()) < 2 + devices:
                    assert service.is_running()
                    time.sleep(0.01)
                service.terminate()
                assert service.wait(10) == 0


def test_an_engine_that_cannot_start_says_why_once() -> None:
    options = ("--edges", "2", "--http", "127.0.0.1:0", "--quic", "off", "--scenes", "/nowhere/at/all")
    result = subprocess.run([TIGAS, "render", *options], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 1
    assert result.stderr.splitlines() == [
        "The models directory /nowhere/at/all does not exist; create it, or choose another with --scenes."
    ]
    assert sys.executable not in result.stdout
