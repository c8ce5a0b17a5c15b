"""Starting, stopping, being killed, and losing the link's foundations."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.eventually import wait_until
from tests.testbed.conftest import ip_forward, left_behind, remove_abandoned, shaper
from tests.testbed.inside import GATEWAY, echo_server, udp
from tigas_common.errors import StartError, UsageError
from tigas_common.processes import tigas_command
from tigas_common.topology import SHAPER
from tigas_testbed.cli import _stop_event
from tigas_testbed.namespaces import Lab
from tigas_testbed.services import PORTS, run_demo, shaper_command


def answers(lab: Lab) -> bool:
    """Whether a datagram comes back from the service."""
    with udp(lab, "client") as client:
        client.settimeout(0.3)
        client.sendto(b"ping", GATEWAY)
        try:
            return client.recv(16) == b"ping"
        except (TimeoutError, ConnectionRefusedError):
            return False


def test_stopping_is_quick_and_leaves_nothing_behind(own_lab: Lab) -> None:
    before = ip_forward(own_lab)
    with echo_server(own_lab), shaper(own_lab) as running:
        assert answers(own_lab)
        assert left_behind(own_lab)
        start = time.monotonic()
        running.process.send_signal(signal.SIGTERM)
        assert running.process.wait(10) == 0
        assert time.monotonic() - start < 3, "Compose kills what takes longer"
        assert left_behind(own_lab) == []
        assert ip_forward(own_lab) == before
        assert not answers(own_lab)


def test_after_a_kill_nothing_passes_and_the_next_start_cleans_up(own_lab: Lab) -> None:
    with echo_server(own_lab):
        with shaper(own_lab) as first:
            assert answers(own_lab)
            first.process.kill()
            first.process.wait()
            wait_until(lambda: not answers(own_lab))
        with shaper(own_lab) as second:
            second.post("/link", down_kbps=5_000, up_kbps=5_000)
            assert answers(own_lab)
            second.process.terminate()
            second.process.wait()
        assert left_behind(own_lab) == []


def test_a_second_shaper_refuses_and_the_first_goes_on(own_lab: Lab) -> None:
    with echo_server(own_lab), shaper(own_lab):
        second = subprocess.run(own_lab.command("gateway", shaper_command()), capture_output=True, text=True)
        assert second.returncode == 1
        assert second.stderr.strip() == "Another shaper is already running on this network; stop it first."
        assert answers(own_lab)


@pytest.mark.parametrize("interface", ["access", "service", "tigas-down"])
def test_an_interface_that_disappears_closes_the_link(own_lab: Lab, interface: str) -> None:
    with echo_server(own_lab), shaper(own_lab) as running:
        # The API stays reachable from this test when the access side is removed.
        gone = own_lab.command("gateway", ["ip", "link", "del", interface])
        status = own_lab.command("gateway", ["python3", "-c", STATUS])
        assert answers(own_lab)
        subprocess.run(gone, check=True)

        def closed() -> str | None:
            answer = subprocess.run(status, check=True, capture_output=True, text=True).stdout
            reason: str | None = json.loads(answer)["closed"]
            return reason

        wait_until(lambda: closed() is not None)
        print(closed())
        assert "nothing passes until the shaper is restarted" in (closed() or "")
        if interface == "tigas-down":
            assert not answers(own_lab)
            code, problem = running.request("POST", "/link", b'{"down_kbps": 1000, "up_kbps": 1000}')
            assert (code, problem["type"]) == (503, "tigas:link-closed")
            assert running.request("GET", "/healthz")[0] == 503
        running.process.terminate()
        assert running.process.wait(10) == 0


@pytest.mark.parametrize("interface", ["access", "service"])
def test_shaping_that_another_program_removes_closes_the_link(own_lab: Lab, interface: str) -> None:
    with echo_server(own_lab), shaper(own_lab):
        assert answers(own_lab)
        removal = ["tc", "qdisc", "del", "dev", interface, "clsact"]
        subprocess.run(own_lab.command("gateway", removal), check=True)
        wait_until(lambda: not answers(own_lab))


def test_packets_longer_than_the_link_takes_are_refused_from_the_start(own_lab: Lab) -> None:
    longer = ["ip", "link", "set", "access", "mtu", "9000"]
    subprocess.run(own_lab.command("gateway", longer), check=True)
    run = subprocess.run(own_lab.command("gateway", shaper_command()), capture_output=True, text=True)
    assert run.returncode == 1
    assert "access has an MTU of 9000: ip link set access mtu 3000" in run.stderr


STATUS = f"import urllib.request as u; print(u.urlopen('http://{SHAPER.loopback}/status').read().decode())"


def test_wrong_settings_get_one_sentence(own_lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TIGAS_SHAPER_TRACE", "nothing")
    for change, sentence in (
        (("--access", "nope0"), "There is no network interface nope0."),
        (("--access", "x; rm -rf /"), "'x; rm -rf /' is not the name of a network interface."),
        (("--service", "access"), "The clients and the services must be on different interfaces"),
        (("--service", "10.99.0.0/16"), "No network interface has an address in 10.99.0.0/16."),
        (("--forward", "tcp:99999=a:1"), "is not tcp:PORT=HOST:PORT"),
        (("--traces", "/nowhere"), "The directory /nowhere does not exist"),
        ((), "There is no trace named 'nothing'."),
    ):
        command = own_lab.command("gateway", shaper_command(*change))
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 1, run
        assert sentence in run.stderr
        assert run.stderr.count("\n") == 1
        assert left_behind(own_lab) == []


def test_without_the_right_it_says_what_is_missing(own_lab: Lab) -> None:
    command = own_lab.command("gateway", ["setpriv", "--bounding-set", "-net_admin", *shaper_command()])
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 1
    assert "CAP_NET_ADMIN" in run.stderr
    assert run.stderr.count("\n") == 1


def test_a_lab_is_alone_with_its_name_and_the_next_tests_spare_it(own_lab: Lab) -> None:
    with pytest.raises(StartError, match="already up"), Lab(own_lab.name).up(PORTS):
        pass
    remove_abandoned()
    assert own_lab.exists()


HOLDER = """
import signal, sys, threading
from tigas_testbed.namespaces import Lab
stopped = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: stopped.set())
with Lab(sys.argv[1]).up():
    print("up", flush=True)
    while not stopped.wait(0.1):
        pass
print("ended in order", flush=True)
"""


def test_a_running_lab_is_told_to_stop_and_can_be_started_again_at_once() -> None:
    lab = Lab(f"t{os.getpid()}")
    with subprocess.Popen([sys.executable, "-c", HOLDER, lab.name], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == "up\n"
        lab.stop()
        assert holder.stdout.readline() == "ended in order\n"
    assert not lab.exists()
    with lab.up():
        assert lab.exists()
    lab.stop()  # which is not up


ENDS = (signal.SIGINT, signal.SIGTERM)
ANYWHERE = {"TIGAS_DASH_HTTP": "127.0.0.1:0", "TIGAS_STORE_HTTP": "127.0.0.1:0"}


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Started on free ports, with results in a temporary directory."""
    argv = tigas_command("demo", "--", "--http", "127.0.0.1:0", "--quic", "127.0.0.1:0")
    with subprocess.Popen(argv, cwd=tmp_path, env=os.environ | ANYWHERE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def service(demo: subprocess.Popen[str], name: str) -> psutil.Process | None:
    children = psutil.Process(demo.pid).children()
    return next((child for child in children if f"tigas_common {name}" in " ".join(child.cmdline())), None)


def test_a_service_that_is_killed_comes_back_and_all_end_together(demo: subprocess.Popen[str]) -> None:
    wait_until(lambda: all(service(demo, name) for name in ("render", "dash", "store")))
    killed = service(demo, "store")
    assert killed
    killed.kill()
    assert demo.stderr
    assert demo.stderr.readline() == ("The experiment store exited (signal SIGKILL); restarting it in 0.5 s.\n")
    wait_until(lambda: service(demo, "store") not in (None, killed))
    services = psutil.Process(demo.pid).children()
    demo.terminate()
    assert demo.wait(20) == 0
    assert psutil.wait_procs(services, timeout=10)[1] == []


def test_wrong_options_end_it_with_the_service_s_own_sentence() -> None:
    argv = tigas_command("demo", "--", "--scenes", "/nowhere")
    run = subprocess.run(argv, env=os.environ | ANYWHERE, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert "/nowhere" in run.stderr
    assert run.stderr.splitlines()[-1] == "The render service did not start (exit status 1), so the others end as well."


def test_the_other_services_find_a_render_service_at_another_port(monkeypatch: pytest.MonkeyPatch) -> None:
    environments: list[dict[str, str]] = []
    monkeypatch.setattr("tigas_testbed.services.Service", lambda name, start: start())
    monkeypatch.setattr("tigas_testbed.services.keep_running", lambda services, stop: None)
    monkeypatch.setattr(subprocess, "Popen", lambda argv, *, env, **rest: environments.append(env))
    run_demo(("--http=0.0.0.0:9000",), threading.Event(), store=True)
    assert {env["TIGAS_DASH_RENDER"] for env in environments} == {"http://localhost:9000"}
    assert {env["TIGAS_STORE_RENDER"] for env in environments} == {"http://localhost:9000"}
    with pytest.raises(UsageError, match="--htpp"):
        run_demo(("--htpp=0.0.0.0:9000",), threading.Event(), store=True)


@pytest.mark.timeout(10)
def test_signals_while_the_event_is_locked_end_the_wait() -> None:
    before = [signal.getsignal(number) for number in ENDS]
    try:
        stop = _stop_event()
        with stop._cond:  # type: ignore[attr-defined]  # as in the midst of a wait
            for number in ENDS:
                signal.raise_signal(number)
        assert stop.wait(5)
    finally:
        for number, handler in zip(ENDS, before, strict=True):
            signal.signal(number, handler)
