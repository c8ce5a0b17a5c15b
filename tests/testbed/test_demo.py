"""`tigas demo`, the services without a link, as `make demo` starts them."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.testbed.inside import wait_until
from tigas_common.processes import tigas
from tigas_testbed.cli import _told_to_stop

ENDS = (signal.SIGINT, signal.SIGTERM)
ANYWHERE = {"TIGAS_DASH_HTTP": "127.0.0.1:0", "TIGAS_STORE_HTTP": "127.0.0.1:0"}


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Started on free ports, with results in a temporary directory."""
    argv = tigas("demo", "--", "--http", "127.0.0.1:0", "--quic", "127.0.0.1:0")
    with subprocess.Popen(argv, cwd=tmp_path, env=os.environ | ANYWHERE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def service(demo: subprocess.Popen[str], name: str) -> psutil.Process | None:
    """One of its services."""
    children = psutil.Process(demo.pid).children()
    return next((child for child in children if f"tigas_common {name}" in " ".join(child.cmdline())), None)


def test_a_service_that_is_killed_comes_back_and_all_end_together(demo: subprocess.Popen[str]) -> None:
    wait_until(lambda: all(service(demo, name) for name in ("render", "dash", "store")), 20)
    killed = service(demo, "store")
    assert killed
    killed.kill()
    assert demo.stderr
    assert demo.stderr.readline() == (
        "The experiment store has ended (signal SIGKILL); it is started again in 0.5 s.\n"
    )
    wait_until(lambda: service(demo, "store") not in (None, killed), 20)
    services = psutil.Process(demo.pid).children()
    demo.terminate()
    assert demo.wait(20) == 0
    assert psutil.wait_procs(services, timeout=10)[1] == []


def test_wrong_options_end_it_with_the_service_s_own_sentence() -> None:
    argv = tigas("demo", "--", "--scenes", "/nowhere")
    run = subprocess.run(argv, env=os.environ | ANYWHERE, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert "/nowhere" in run.stderr
    assert run.stderr.splitlines()[-1] == "The render service did not start (exit status 1), so the others end as well."


@pytest.mark.timeout(10)
def test_signals_while_the_event_is_locked_end_the_wait() -> None:
    before = [signal.getsignal(number) for number in ENDS]
    try:
        stop = _told_to_stop()
        with stop._cond:  # type: ignore[attr-defined]  # as in the midst of a wait
            for number in ENDS:
                signal.raise_signal(number)
        assert stop.wait(5)
    finally:
        for number, handler in zip(ENDS, before, strict=True):
            signal.signal(number, handler)
