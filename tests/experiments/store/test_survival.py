"""What survives: a full disk, a killed store, a second store; and what the store does not need."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import anyio
import httpx
import pytest

from tests.experiments.made_up import inputs
from tests.experiments.store.conftest import Running, running_store, until, upload
from tests.experiments.store.test_hostile import head
from tests.web.server import Store
from tigas_common.errors import InvalidRequest, Overloaded, StartError
from tigas_common.wire.store import ExperimentRequest
from tigas_experiments.store.apart import in_a_process
from tigas_experiments.store.intake import parsed
from tigas_experiments.store.workspace import NAME, Workspace

pytestmark = pytest.mark.anyio
DISK_BYTES = 1_000_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A results directory on a disk of its own, which takes DISK_BYTES."""
    disk = tmp_path / "results"
    disk.mkdir()
    mount = ("mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(disk))
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs root")
    try:
        yield tmp_path
    finally:
        subprocess.run(("umount", "--lazy", str(disk)), check=True)


def fill(path: Path) -> None:
    """Leave no room on a file's disk."""
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))


def long_upload(poses: int) -> bytes:
    """A valid run with so many poses."""
    walked = [entry.model_dump() for entry in inputs(poses, every_ms=0.01)]
    return json.dumps(upload(inputs=walked)).encode()


# As the body comes, and as the run is written beside it.
@pytest.mark.parametrize("poses", [20_000, 7_000])
async def test_a_full_disk_keeps_nothing_by_halves(small_disk: Path, poses: int) -> None:
    async with running_store(small_disk) as store:
        experiment = await store.create()
        await store.add(experiment)
        before = store.kept()
        body = long_upload(poses)
        assert (len(body) > DISK_BYTES) == (poses == 20_000)
        answer = await store.http.post(f"/experiments/{experiment}/runs", content=body)
        assert (answer.status_code, answer.json()["type"]) == (507, "tigas:disk-full")
        assert store.kept() == before
        await store.add(experiment, repeat=1)
        told = (await store.http.get(f"/experiments/{experiment}")).json()
        assert [run["status"] for run in told["runs"]] == ["complete", "complete"]


async def test_a_disk_without_any_room_is_told_and_reads_on(small_disk: Path) -> None:
    async with running_store(small_disk) as store:
        experiment = await store.create()
        await store.add(experiment)
        fill(store.results / "filler")
        before = store.kept()
        for answer in (
            await store.http.post("/experiments", json={"name": "a", "plan": {"x": "x" * 10_000}}),
            await store.http.post(f"/experiments/{experiment}/runs", json=upload()),
            await store.http.get(f"/experiments/{experiment}/report"),
        ):
            assert (answer.status_code, answer.json()["type"]) == (507, "tigas:disk-full")
        assert store.kept() == before
        assert (await store.http.get(f"/experiments/{experiment}/zip")).status_code == 200
        assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204


async def test_a_store_that_is_killed_in_mid_upload_leaves_no_half_run(tmp_path: Path) -> None:
    results = tmp_path / "results"
    with Store("--results", str(results)) as store:
        async with httpx.AsyncClient(base_url=store.url, timeout=20, trust_env=False) as http:
            experiment = (await http.post("/experiments", json={"name": "a", "plan": {}})).json()["id"]
            row = (await http.post(f"/experiments/{experiment}/runs", json=upload())).json()
        body = json.dumps(upload(mode="dash-tuned")).encode()
        async with await anyio.connect_tcp("127.0.0.1", int(store.url.rpartition(":")[2])) as sending:
            await sending.send(head(experiment, len(body)) + body[:-10])
            await until(lambda: any((results / NAME).rglob("body.json")))
            store.kill()
        assert list((results / NAME).rglob("body.json")), "nothing was left behind, so nothing is tested"
        store.start()
        assert [path.name for path in (results / NAME).iterdir()] == ["lock"]
        async with httpx.AsyncClient(base_url=store.url, timeout=20, trust_env=False) as http:
            told = (await http.get(f"/experiments/{experiment}")).json()
            assert [run["folder"] for run in told["runs"]] == [row["folder"]]
            again = await http.post(f"/experiments/{experiment}/runs", content=body)
            assert again.status_code == 201
            assert b"courtyard" in (await http.get(f"/experiments/{experiment}/report")).content


def end_myself(how: int) -> None:
    """As the system ends a process that takes too much memory."""
    os.kill(os.getpid(), how)


async def test_work_that_the_system_ends_is_told_and_the_next_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as without:
        without.setattr(sys, "executable", "/nowhere/python")
        with pytest.raises(Overloaded, match="No process can be started"):
            await in_a_process(os.getppid)
    with pytest.raises(Overloaded, match="ended by the system"):
        await in_a_process(end_myself, signal.SIGKILL)
    assert await in_a_process(os.getppid) == os.getpid()
    with pytest.raises(InvalidRequest) as raised:
        await in_a_process(parsed, ExperimentRequest, b"{")
    assert raised.value.detail.startswith("Invalid JSON")


def test_a_second_store_of_the_same_results_is_refused(tmp_path: Path) -> None:
    with Workspace.opened(tmp_path):
        with pytest.raises(StartError, match="Another store keeps its results"), Workspace.opened(tmp_path):
            pass
        with pytest.raises(AssertionError, match="Another store keeps its results"), Store("--results", str(tmp_path)):
            pass
    with Workspace.opened(tmp_path):
        pass


def test_the_store_needs_neither_a_browser_nor_torch() -> None:
    script = (
        "import sys; import tigas_experiments.store.main; "
        "print([name for name in ('playwright', 'torch', 'numba', 'httpx', 'av', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


async def test_a_results_folder_that_may_not_be_written_is_told(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    experiment = await store.create()
    before = store.kept()
    monkeypatch.setattr(Path, "rename", refused)
    answer = await store.http.post(f"/experiments/{experiment}/runs", json=upload())
    assert (answer.status_code, answer.json()["type"]) == (500, "tigas:storage-failed")
    assert answer.json()["detail"] == "The store's disk refused: Permission denied."
    assert store.kept() == before
