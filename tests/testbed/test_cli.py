"""`tigas lab up`, `exec` and `down`, as a person uses them."""

from __future__ import annotations

import json
import ssl
import stat
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.request import Request, urlopen

import httpx
import pytest

from tests.eventually import wait_until
from tests.prerequisites import FREE_LAB
from tests.render.scenes import made_up
from tests.render.uploads.client import begin, part
from tigas_common.files import NOBODY
from tigas_common.processes import tigas_command
from tigas_common.resources import CAP_NET_ADMIN
from tigas_common.topology import DASH, PAGE, PAGE_HTTPS, PAGE_ORIGINS, SHAPER, STORE
from tigas_testbed.namespaces import ROLES, Lab, Role
from tigas_testbed.services import NAME

pytestmark = pytest.mark.alone

LAB = Lab(NAME)
DELAY_MS = 150
"""One way."""


def serves(port: int = PAGE.number) -> bool:
    """Whether the page's server, or another one, answers at this machine's own localhost, through the lab."""
    try:
        with urlopen(f"http://localhost:{port}/healthz", timeout=1) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def set_link(**setting: float) -> None:
    asking = Request(
        f"http://localhost:{SHAPER.number}/link", json.dumps(setting).encode(), {"Origin": PAGE_ORIGINS[0]}
    )
    with urlopen(asking, timeout=10):
        pass


def asked_over_https(service: str) -> float:
    """How long a service's health takes through the page's origin, in seconds."""
    start = time.monotonic()
    url = f"https://localhost:{PAGE_HTTPS.number}/services/{service}/healthz"
    with urlopen(url, timeout=20, context=ssl._create_unverified_context()) as answer:
        assert answer.status == 200
    return time.monotonic() - start


def left() -> list[str]:
    """Parts of the lab on this machine."""
    commands = (("ip", "netns", "list"), ("ip", "-br", "link"), ("nft", "list", "tables"))
    lines = [subprocess.run(argv, check=True, capture_output=True, text=True).stdout for argv in commands]
    return [line for text in lines for line in text.splitlines() if "tigas-lab" in line or "tigas_lab_lab" in line]


@pytest.fixture
def up(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A lab, once its page is served. Its directories are the test's own."""
    FREE_LAB.require()
    tmp_path.chmod(0o755)  # the services' user is another one
    argv = tigas_command("lab", "up", "--https", f"127.0.0.1:{PAGE_HTTPS.number}")
    process = subprocess.Popen(argv, cwd=tmp_path)
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
    exec_client = tigas_command("lab", "exec", "client", "ip", "-br", "link", "show", "access")
    assert "access@" in subprocess.run(exec_client, check=True, capture_output=True, text=True).stdout
    wait_until(lambda: all(map(serves, (DASH.number, SHAPER.number, STORE.number))))
    assert (tmp_path / "results").is_dir()
    set_link(down_kbps=10_000, up_kbps=10_000, delay_ms=DELAY_MS)
    for service in ("dash", "store", "shaper"):
        assert asked_over_https(service) > 2 * DELAY_MS / 1000, "it did not cross the link"
    second = subprocess.run(tigas_command("lab", "up"), capture_output=True, text=True)
    assert (second.returncode, second.stderr) == (1, "The lab is already up; stop it with `tigas lab down`.\n")
    pids = [pid for role in ROLES for pid in LAB.processes(role)]
    assert pids
    up.kill()
    up.wait()
    wait_until(lambda: not any(LAB.processes(role) for role in ROLES))
    assert not serves()
    subprocess.run(tigas_command("lab", "down"), check=True)
    assert left() == []


def statuses(role: Role) -> dict[int, dict[str, str]]:
    """The kernel's status of each process in a namespace, by its id, with its command line as `Command`."""
    found = {}
    for pid in LAB.processes(role):
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
            found[pid] = dict(line.split(":\t", 1) for line in lines)
            found[pid]["Command"] = " ".join(Path(f"/proc/{pid}/cmdline").read_text().split("\0"))
    return found


def test_services_are_nobody_in_particular_and_have_no_rights(up: subprocess.Popen[bytes], tmp_path: Path) -> None:
    wait_until(lambda: all(map(serves, (DASH.number, SHAPER.number, STORE.number))))
    services, gateway = statuses("service"), statuses("gateway")
    for service in ("render", "dash", "store"):
        assert any(f"tigas_common {service} " in status["Command"] for status in services.values())
    assert any("tigas_common shaper " in status["Command"] for status in gateway.values())
    shaping = 1 << CAP_NET_ADMIN | 1 << 23  # CAP_SYS_NICE
    for status, rights in (*((each, 0) for each in services.values()), *((each, shaping) for each in gateway.values())):
        assert set(status["Uid"].split()) == {str(NOBODY)}, status["Command"]
        assert status["Groups"].split() == []
        assert {int(status[kind], 16) for kind in ("CapEff", "CapPrm", "CapBnd", "CapInh")} == {rights}
        assert status["NoNewPrivs"] == "1"
    assert (tmp_path / "results/.store").stat().st_uid == NOBODY, "the store writes there"
    up.terminate()
    assert up.wait(20) == 0
    assert (tmp_path / "results/.store").stat().st_uid == 0, "results are the caller's"


def test_a_scene_that_a_page_adds_is_the_callers_afterwards(up: subprocess.Popen[bytes], tmp_path: Path) -> None:
    shell = (made_up.FILES / "shell-3.spz").read_bytes()
    with httpx.Client(base_url=PAGE_ORIGINS[0], timeout=60) as client:
        assert client.get("/config.json").json()["max_upload_bytes"], "scenes can be added"
        at = "/" + client.post("/uploads", headers=begin("shell.spz", len(shell))).headers["location"]
        assert client.patch(at, headers=part(0), content=shell).status_code == 204
        assert client.post(f"{at}/scene").status_code == 201
    models, scene = tmp_path / "models", tmp_path / "models/shell.spz"
    assert (models.stat().st_uid, scene.stat().st_uid) == (NOBODY, NOBODY)
    assert models.stat().st_mode & stat.S_IWOTH == 0
    up.terminate()
    assert up.wait(20) == 0
    assert scene.read_bytes() == shell
    assert (models.stat().st_uid, scene.stat().st_uid, scene.stat().st_mode & 0o777) == (0, 0, 0o644)
