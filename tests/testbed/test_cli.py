"""`tigas lab up`, `exec` and `down`, as a person uses them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

from tests.testbed.inside import wait_until
from tigas_common.errors import StartError
from tigas_common.processes import tigas
from tigas_common.topology import DASH, PAGE, SHAPER, STORE
from tigas_testbed.namespaces import ROLES, Lab
from tigas_testbed.services import NAME

LAB = Lab(NAME)


def serves(port: int = PAGE.number) -> bool:
    """Whether the page's server, or another one, answers at this machine's own localhost, through the lab."""
    try:
        with urlopen(f"http://localhost:{port}/healthz", timeout=1) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def left() -> list[str]:
    """What there is of the lab on this machine."""
    commands = (("ip", "netns", "list"), ("ip", "-br", "link"), ("nft", "list", "tables"))
    lines = [subprocess.run(argv, check=True, capture_output=True, text=True).stdout for argv in commands]
    return [line for text in lines for line in text.splitlines() if "tigas-lab" in line or "tigas_lab_lab" in line]


@pytest.fixture
def up(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A lab, once its page is served. Experiments are in `results`."""
    try:
        with LAB.up():
            pass
    except StartError as error:
        pytest.skip(f"a lab is in use on this machine: {error}")
    if serves():
        pytest.skip("something else serves localhost:8080 on this machine")
    process = subprocess.Popen(tigas("lab", "up"), env=os.environ | {"TIGAS_STORE_RESULTS": str(tmp_path / "results")})
    try:
        wait_until(lambda: process.poll() is None and serves(), 90)
        yield process
    finally:
        process.kill()
        process.wait()
        LAB.remove()


def test_a_lab_comes_up_for_this_machine_and_goes_even_after_a_kill(
    up: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    exec_client = tigas("lab", "exec", "client", "ip", "-br", "link", "show", "access")
    assert "access@" in subprocess.run(exec_client, check=True, capture_output=True, text=True).stdout
    wait_until(lambda: all(map(serves, (DASH.number, SHAPER.number, STORE.number))), 20)
    assert (tmp_path / "results").is_dir()
    second = subprocess.run(tigas("lab", "up"), capture_output=True, text=True)
    assert (second.returncode, second.stderr) == (1, "The lab is already up; `tigas lab down` ends it.\n")
    pids = [pid for role in ROLES for pid in LAB.processes(role)]
    assert pids
    up.kill()
    up.wait()
    wait_until(lambda: not any(LAB.processes(role) for role in ROLES), 5)
    assert not serves()
    subprocess.run(tigas("lab", "down"), check=True)
    assert left() == []
