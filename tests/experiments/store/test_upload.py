"""Uploaded runs: refusals, interruptions, and a full or lost disk."""

from __future__ import annotations

import contextlib
import http.client
import json
import subprocess
from collections.abc import AsyncIterator, Iterator, Mapping
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import pytest

from tests.eventually import eventually
from tests.experiments.made_up import frame, inputs, reply, sample
from tests.experiments.store.conftest import Running, plan, running_store, slug, upload
from tests.prerequisites import ROOT_RIGHTS
from tests.prometheus import figures
from tigas_common.errors import InvalidRequest
from tigas_common.limits import HttpLimits
from tigas_common.offload import offload_to_process
from tigas_common.parsing import parse
from tigas_experiments.store import app
from tigas_experiments.store.limited import check_limit
from tigas_experiments.wire.store import RunUpload

pytestmark = pytest.mark.anyio


DISK_BYTES = 1_000_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A results directory on a separate disk of DISK_BYTES."""
    disk = tmp_path / "results"
    disk.mkdir()
    mount = ("mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(disk))
    if subprocess.run(mount, capture_output=True).returncode:
        ROOT_RIGHTS.skip()
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
    """A valid run of the mode `dash-tuned` with this many poses."""
    walked = [entry.model_dump() for entry in inputs(poses, every_ms=0.01)]
    return json.dumps(upload("dash-tuned", inputs=walked)).encode()


def head(experiment: str, length: int, folder: str | None = None) -> bytes:
    path = f"/experiments/{experiment}/runs/{folder or slug()}"
    return f"PUT {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n".encode()


FAR = 1e300


LENS = {"width": 64, "height": 36, "fx": 30, "fy": 30, "cx": 32, "cy": 18}


HOSTILE: list[tuple[dict[str, Any], str]] = [
    ({"recording": None}, "a recording or a problem"),
    ({"link": [{"at": 0}]}, "link.0"),
    ({"surprise": 1}, "surprise"),
    ({"recording.scene": "elsewhere"}, "scene"),
    ({"recording.mode": "dash"}, "mode"),
    ({"recording.mode": "magic"}, "mode"),
    ({"recording.duration_ms": 5000}, "lasts 5000 ms, not 1 s"),
    ({"recording.duration_ms": FAR}, "lasts"),
    ({"recording.ended_ms": FAR}, "ended long after"),
    ({"recording.started_unix_ms": FAR}, "start time"),
    ({"recording.started_unix_ms": -1}, "start time"),
    ({"recording.inputs": [{"at": -FAR, "pose": 1, "position": [0, 0, 0], "quaternion": [0, 0, 0, 1]}]}, "long before"),
    ({"recording.replies": [reply(FAR, 0).model_dump()]}, "long after"),
    ({"recording.replies": [reply(0, 5).model_dump() | {"at": FAR}]}, "within ten minutes"),
    ({"recording.traffic": [{"at": 0, "bytes": 0}, {"at": 1, "bytes": 10**400}]}, "number of bytes is impossible"),
    ({"recording.traffic": [{"at": 0, "bytes": 0}, {"at": FAR, "bytes": 1}]}, "long after"),
    ({"recording.lens": LENS | {"fx": 0}}, "lens.fx"),
    ({"link": [sample(500).model_dump(), sample(0).model_dump()]}, "must not go back"),
    ({"link": [sample(0).model_dump() | {"target_kbps": FAR}]}, "rates"),
    ({"link": [sample(0).model_dump() | {"delivered_kbps": -1}]}, "rates"),
    ({"problem": ""}, "problem"),
    ({"problem": "x" * 1001}, "problem"),
]


def changed_upload(changes: Mapping[str, Any]) -> dict[str, Any]:
    """An upload with other values at these dotted paths."""
    sent = upload()
    for path, value in changes.items():
        *parents, name = path.split(".")
        inside = sent
        for parent in parents:
            inside = inside[parent]
        inside[name] = value
    return sent


async def refuses(store: Running, experiment: str, content: str) -> str:
    """Why a run is not taken; nothing of it may be kept."""
    before = store.kept()
    answer = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", content=content)
    assert (answer.status_code, answer.json()["type"]) == (400, "tigas:invalid-request"), content[:200]
    assert store.kept() == before
    return str(answer.json()["detail"])


async def test_a_broken_run_is_told_why(store: Running) -> None:
    experiment = await store.create()
    for changes, told in HOSTILE:
        assert told in await refuses(store, experiment, json.dumps(changed_upload(changes))), changes


def repeated(text: str, size: int = 1_000_000) -> str:
    return f"[{','.join([text] * (size // (len(text) + 1)))}]"


def named(value: str, size: int = 1_000_000) -> str:
    """An object of many names."""
    return "{" + ",".join(f'"{number:x}":{value}' for number in range(size // 10)) + "}"


BOMBS = {
    "link": repeated("{}"),
    "recording.inputs": repeated("{}"),
    "recording.frames": repeated(json.dumps(frame(0, 1).model_dump() | {"latencies": ["x"] * 100})),
    "recording.traffic": f"[{named('0')}]",
    "recording": named("{}", 600_000),  # of a megabyte's names, pydantic's account takes all the memory that there is
    "surprise": named(repeated("0", 10)),
    "problem": repeated("0"),
    "recording.lens": "[" * 500_000 + "]" * 500_000,
    "recording.dash": '{"player":' * 100_000 + "0" + "}" * 100_000,
    "recording.duration_ms": "9" * 1_000_000,
    "sampling_problem": r'"\ud800"',
}


async def test_metrics_tell_what_came_in_what_was_kept_and_what_waits(store: Running) -> None:
    experiment = await store.create()
    empty = await figures(store.http)
    await store.add(experiment)
    refused = await store.http.put(f"/experiments/{experiment}/runs/{slug('dash-tuned')}", content=b"x" * 1000)
    assert refused.status_code == 400
    told = await figures(store.http)
    assert told("tigas_store_runs_total") - empty("tigas_store_runs_total") == 1
    assert told("tigas_store_received_bytes_total") > 1000
    for queue in ("check", "report", "materialise"):
        assert told("tigas_store_waiting", queue=queue) == told("tigas_store_queue_age_seconds", queue=queue) == 0
    assert told("tigas_store_free_bytes") > 0
    assert told("tigas_http_requests_total", route="/experiments/{id}/runs/{run}") == 2


async def test_a_megabyte_of_mistakes_is_told_as_cheaply_as_one() -> None:
    for where, bomb in BOMBS.items():
        body = json.dumps(changed_upload({where: "HERE"})).replace('"HERE"', bomb).encode()
        with pytest.raises(InvalidRequest) as refused:
            await offload_to_process(parse, RunUpload, body, len(body), limit=check_limit(len(body)))
        assert len(refused.value.detail) < 200, where


@pytest.mark.slow
async def test_a_body_that_takes_too_much_is_refused_and_the_store_goes_on(tmp_path: Path) -> None:
    async with running_store(tmp_path, offload=offload_to_process) as store:
        experiment = await store.create()
        before = store.kept()
        answer = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", content=named("0", 30_000_000))
        assert (answer.status_code, answer.json()["type"]) == (422, "tigas:too-costly")
        assert store.kept() == before
        await store.add(experiment)


async def test_only_numbers_are_numbers(store: Running) -> None:
    experiment = await store.create()
    text = json.dumps(upload())
    for field in ('"duration_ms": 1000.0', '"at": 40.0', '"target_kbps": 20000.0'):
        assert field in text
        for number in ("NaN", "Infinity", "-Infinity", "1e999", "null", '"1"', "true"):
            await refuses(store, experiment, text.replace(field, f"{field.partition(':')[0]}: {number}", 1))


async def test_text_that_breaks_off_is_no_run(store: Running) -> None:
    experiment = await store.create()
    text = json.dumps(upload())
    for length in (0, 1, len(text) // 2, len(text) - 1):
        await refuses(store, experiment, text[:length])


async def test_a_run_without_end_is_refused_before_it_is_read(store: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = await store.create()
    before = store.kept()
    connection = http.client.HTTPConnection("127.0.0.1", store.port, timeout=20)
    connection.putrequest("PUT", f"/experiments/{experiment}/runs/{slug()}")
    connection.putheader("Content-Length", str(300_000_000))
    connection.endheaders()
    answer = await anyio.to_thread.run_sync(connection.getresponse)
    assert answer.status == 413
    connection.close()

    async def endless() -> AsyncIterator[bytes]:
        for _ in range(100):
            yield b" " * 10_000

    monkeypatch.setattr(app, "MAX_BYTES", 50_000)
    refused = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", content=endless())
    assert (refused.status_code, refused.json()["type"]) == (413, "tigas:body-too-large")
    assert store.kept() == before


async def test_an_upload_that_falls_silent_is_given_up(tmp_path: Path) -> None:
    async with running_store(tmp_path, limits=HttpLimits(body_s=0.2)) as store:
        experiment = await store.create()
        before = store.kept()
        async with await anyio.connect_tcp("127.0.0.1", store.port) as silent:
            await silent.send(head(experiment, 1000) + b"{")
            with anyio.fail_after(5):
                told = await silent.receive()
        assert b"408 Request Timeout" in told
        await eventually(lambda: store.kept() == before)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
async def test_a_socket_that_closes_in_mid_upload_leaves_nothing(
    store: Running, share: float, caplog: pytest.LogCaptureFixture
) -> None:
    experiment = await store.create()
    before = store.kept()
    body = json.dumps(upload()).encode()
    async with await anyio.connect_tcp("127.0.0.1", store.port) as closing:
        await closing.send(head(experiment, len(body) + 1) + body[: int(share * len(body))])
        await eventually(lambda: store.kept() != before)
    await eventually(lambda: store.kept() == before)
    assert caplog.records == [], "a client that leaves is no failure of the store"
    assert (await store.http.get(f"/experiments/{experiment}")).json()["runs"] == []


async def test_an_experiment_that_is_removed_in_mid_upload_stays_removed(store: Running) -> None:
    experiment = await store.create()
    body = json.dumps(upload()).encode()
    async with await anyio.connect_tcp("127.0.0.1", store.port) as slow:
        await slow.send(head(experiment, len(body)) + body[:100])
        await eventually(lambda: any("body.json" in path for path in store.kept()))
        assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204
        await slow.send(body[100:])
        assert b"404 Not Found" in await slow.receive()
    assert store.kept() == []


# While the body is received, and while the run is written.
@pytest.mark.parametrize("poses", [20_000, 7_000])
async def test_a_full_disk_keeps_nothing_by_halves(small_disk: Path, poses: int) -> None:
    async with running_store(small_disk) as store:
        experiment = await store.create()
        await store.add(experiment)
        before = store.kept()
        body = long_upload(poses)
        assert (len(body) > DISK_BYTES) == (poses == 20_000)
        answer = await store.http.put(f"/experiments/{experiment}/runs/{slug('dash-tuned')}", content=body)
        assert (answer.status_code, answer.json()["type"]) == (507, "tigas:disk-full")
        assert store.kept() == before
        await store.add(experiment, "dash-tuned")
        told = (await store.http.get(f"/experiments/{experiment}")).json()
        assert [run["status"] for run in told["runs"]] == ["complete", "complete"]


async def test_a_disk_without_any_room_is_told_and_reads_on(small_disk: Path) -> None:
    async with running_store(small_disk) as store:
        experiment = await store.create()
        await store.add(experiment)
        fill(store.results / "filler")
        before = store.kept()
        for answer in (
            await store.http.post("/experiments", json=plan()),
            await store.http.put(f"/experiments/{experiment}/runs/{slug('dash-tuned')}", json=upload("dash-tuned")),
            await store.http.get(f"/experiments/{experiment}/report"),
        ):
            assert (answer.status_code, answer.json()["type"]) == (507, "tigas:disk-full")
        assert store.kept() == before
        assert (await store.http.get(f"/experiments/{experiment}/zip")).status_code == 200
        assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204


async def test_a_results_folder_that_may_not_be_written_is_told(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    experiment = await store.create()
    before = store.kept()
    monkeypatch.setattr(Path, "rename", refused)
    answer = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", json=upload())
    assert (answer.status_code, answer.json()["type"]) == (500, "tigas:storage-failed")
    assert answer.json()["detail"] == "The disk that holds the results reported an error: Permission denied."
    assert store.kept() == before
