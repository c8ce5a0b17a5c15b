"""What must not get in, whatever is sent: names that lead elsewhere, broken JSON, bodies without end."""

from __future__ import annotations

import http.client
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import pytest

from tests.experiments.made_up import reply, sample, write_run
from tests.experiments.store.conftest import Running, until, upload
from tests.experiments.store.test_experiments import by_command
from tigas_common.errors import StartError
from tigas_experiments.store import app
from tigas_experiments.store.workspace import Workspace

pytestmark = pytest.mark.anyio

ELSEWHERE = [
    "..", ".", "%2e%2e", "%2E", "..%2foutside", "..%2Foutside", "%2e%2e%2foutside", "..%5coutside", "link", ".store",
    "%2fetc", "good%2f..%2f..%2foutside", "good%2fruns", "a%00b", "%00", "%ff%fe", "a" * 300, "%0a", "none",
    "..%252foutside",
]  # fmt: skip


def ask(port: int, method: str, path: str) -> tuple[int, bytes]:
    """A request whose path is sent as it is."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request(method, path)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


async def test_names_lead_nowhere_else(store: Running) -> None:
    outside = by_command(store.results.parent / "outside", 1)
    by_command(store.results / "good", 1)
    (store.results / "link").symlink_to(outside)
    (store.results.parent / "secret.csv").write_text("hidden content")
    before = sorted(outside.rglob("*")), store.kept()
    asked = [("GET", ""), ("GET", "/zip"), ("GET", "/report"), ("DELETE", ""), ("POST", "/runs")]
    for name in ELSEWHERE:
        paths = [(method, f"/experiments/{name}{rest}") for method, rest in asked]
        for method, path in [*paths, *(("GET", f"/movements/{name}{rest}") for rest in ("", "%2f..%2f..%2fsecret"))]:
            status, body = await anyio.to_thread.run_sync(ask, store.port, method, path)
            assert status in (404, 405), (method, path, body)
            assert json.loads(body)["status"] == status
            assert b"hidden content" not in body
    assert (sorted(outside.rglob("*")), store.kept()) == before


async def test_links_inside_the_results_are_not_followed(store: Running) -> None:
    outside = by_command(store.results.parent / "outside", 1)
    name = await store.create()
    experiment = store.results / name
    write_run(experiment / "runs" / "00")
    (experiment / "runs" / "linked").symlink_to(outside / "runs" / "00")
    told = (await store.http.get(f"/experiments/{name}")).json()
    assert [run["folder"] for run in told["runs"]] == ["00"]
    (experiment / "runs").rename(experiment / "moved")
    (experiment / "runs").symlink_to(outside / "runs")
    assert (await store.http.get(f"/experiments/{name}")).json()["runs"] == []
    added = await store.http.post(f"/experiments/{name}/runs", json=upload())
    assert added.status_code == 404
    assert [path.name for path in (outside / "runs").iterdir()] == ["00"]
    assert (await store.http.delete(f"/experiments/{name}")).status_code == 204
    assert (outside / "runs" / "00" / "run.json").is_file()


BROKEN = [
    (b"", "invalid JSON"),
    (b"{", "invalid JSON"),
    (b"[]", "object"),
    (b'{"name": "a"}', "plan"),
    (b'{"name": " ", "plan": {}}', "name"),
    (b'{"name": "a\\u0000b", "plan": {}}', "one line"),
    (b'{"name": "a", "plan": []}', "plan"),
    (b'{"name": "a", "plan": {"x": NaN}}', "finite"),
    (b'{"name": "a", "plan": {"x": [-1e999]}}', "finite"),
    (b'{"name": "a", "plan": {}, "more": 1}', "more"),
    (b'{"name": "a", "plan": {"x": ' + b"[" * 5000 + b"]" * 5000 + b"}}", "recursion"),
    (b'{"name": "a", "plan": {"x": "\\ud800"}}', "invalid JSON"),
    (b'{"name": "\xff", "plan": {}}', "invalid JSON"),
]


async def test_a_broken_experiment_is_told_why(store: Running) -> None:
    for body, told in BROKEN:
        answer = await store.http.post("/experiments", content=body)
        assert (answer.status_code, answer.headers["content-type"]) == (400, "application/problem+json"), body
        assert told.lower() in answer.json()["detail"].lower(), body
    assert store.kept() == []


async def test_a_plan_has_a_limit(store: Running) -> None:
    answer = await store.http.post("/experiments", json={"name": "a", "plan": {"x": "x" * 66_000}})
    assert (answer.status_code, answer.json()["type"]) == (413, "tigas:body-too-large")
    assert store.kept() == []


FAR = 1e300
LENS = {"width": 64, "height": 36, "fx": 30, "fy": 30, "cx": 32, "cy": 18}
HOSTILE: list[tuple[dict[str, Any], str]] = [
    ({"recording": None}, "recording"),
    ({"link": [{"at": 0}]}, "link.0"),
    ({"surprise": 1}, "surprise"),
    ({"recording.scene": "elsewhere"}, "scene"),
    ({"recording.mode": "dash"}, "mode"),
    ({"recording.mode": "magic"}, "mode"),
    ({"recording.duration_ms": 5000}, "lasts 5000 ms, not 1 s"),
    ({"recording.duration_ms": FAR}, "lasts"),
    ({"recording.ended_ms": FAR}, "ended long after"),
    ({"recording.started_unix_ms": FAR}, "century"),
    ({"recording.started_unix_ms": -1}, "century"),
    ({"recording.inputs": [{"at": -FAR, "pose": 1, "position": [0, 0, 0], "quaternion": [0, 0, 0, 1]}]}, "long before"),
    ({"recording.replies": [reply(FAR, 0).model_dump()]}, "long after"),
    ({"recording.replies": [reply(0, 5).model_dump() | {"at": FAR}]}, "within ten minutes"),
    ({"recording.traffic": [{"at": 0, "bytes": 0}, {"at": 1, "bytes": 10**400}]}, "so many bytes"),
    ({"recording.traffic": [{"at": 0, "bytes": 0}, {"at": FAR, "bytes": 1}]}, "long after"),
    ({"recording.lens": LENS | {"fx": 0}}, "lens.fx"),
    ({"link": [sample(500).model_dump(), sample(0).model_dump()]}, "must not go back"),
    ({"link": [sample(0).model_dump() | {"target_kbps": FAR}]}, "rates"),
    ({"link": [sample(0).model_dump() | {"delivered_kbps": -1}]}, "rates"),
    ({"scene_bytes": -1}, "scene_bytes"),
    ({"scene_bytes": 10**400}, "scene_bytes"),
    ({"configuration.duration_s": 0}, "duration_s"),
    ({"configuration.mode": "dash"}, "mode"),
    ({"configuration.network": {"trace": "x" * 101}}, "network.trace"),
    ({"configuration.profile": 999}, "profile"),
]


async def refuses(store: Running, experiment: str, content: str) -> str:
    """Why a run is not taken; nothing of it may be kept."""
    before = store.kept()
    answer = await store.http.post(f"/experiments/{experiment}/runs", content=content)
    assert (answer.status_code, answer.json()["type"]) == (400, "tigas:invalid-request"), content[:200]
    assert store.kept() == before
    return str(answer.json()["detail"])


async def test_a_broken_run_is_told_why(store: Running) -> None:
    experiment = await store.create()
    for changes, told in HOSTILE:
        sent = upload()
        for path, value in changes.items():
            *parents, name = path.split(".")
            inside = sent
            for parent in parents:
                inside = inside[parent]
            inside[name] = value
        assert told in await refuses(store, experiment, json.dumps(sent)), changes


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


async def test_names_in_a_configuration_open_no_file(store: Running) -> None:
    experiment = await store.create()
    network = {"trace": "../../a/b\u2028", "trace_file": "../../etc/passwd"}
    sent = upload()
    sent["configuration"] |= {"movement": "../../../x", "network": network}
    answer = await store.http.post(f"/experiments/{experiment}/runs", json=sent)
    assert answer.status_code == 201
    assert answer.json()["folder"] == "courtyard_x_a-b_stateless-budget_0"
    assert len(list((store.results / experiment / "runs").iterdir())) == 1


async def test_a_run_without_end_is_refused_before_it_is_read(store: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = await store.create()
    before = store.kept()
    connection = http.client.HTTPConnection("127.0.0.1", store.port, timeout=20)
    connection.putrequest("POST", f"/experiments/{experiment}/runs")
    connection.putheader("Content-Length", str(300_000_000))
    connection.endheaders()
    answer = await anyio.to_thread.run_sync(connection.getresponse)
    assert answer.status == 413
    connection.close()

    async def endless() -> AsyncIterator[bytes]:
        for _ in range(100):
            yield b" " * 10_000

    monkeypatch.setattr(app, "MAX_BYTES", 50_000)
    refused = await store.http.post(f"/experiments/{experiment}/runs", content=endless())
    assert (refused.status_code, refused.json()["type"]) == (413, "tigas:body-too-large")
    assert store.kept() == before


async def test_an_upload_that_falls_silent_is_given_up(store: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app, "SILENCE_S", 0.1)
    experiment = await store.create()
    before = store.kept()
    async with await anyio.connect_tcp("127.0.0.1", store.port) as silent:
        await silent.send(head(experiment, 1000) + b"{")
        with anyio.fail_after(5):
            told = await silent.receive()
    assert b"400 Bad Request" in told
    assert store.kept() == before


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
async def test_a_socket_that_closes_in_mid_upload_leaves_nothing(
    store: Running, share: float, caplog: pytest.LogCaptureFixture
) -> None:
    experiment = await store.create()
    before = store.kept()
    body = json.dumps(upload()).encode()
    async with await anyio.connect_tcp("127.0.0.1", store.port) as closing:
        await closing.send(head(experiment, len(body) + 1) + body[: int(share * len(body))])
        await until(lambda: store.kept() != before)
    await until(lambda: store.kept() == before)
    assert caplog.records == [], "a client that leaves is no failure of the store"
    assert (await store.http.get(f"/experiments/{experiment}")).json()["runs"] == []


async def test_an_experiment_that_is_removed_in_mid_upload_stays_removed(store: Running) -> None:
    experiment = await store.create()
    body = json.dumps(upload()).encode()
    async with await anyio.connect_tcp("127.0.0.1", store.port) as slow:
        await slow.send(head(experiment, len(body)) + body[:100])
        await until(lambda: any("body.json" in path for path in store.kept()))
        assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204
        await slow.send(body[100:])
        assert b"404 Not Found" in await slow.receive()
    assert store.kept() == []


def head(experiment: str, length: int) -> bytes:
    """An upload's first lines."""
    return f"POST /experiments/{experiment}/runs HTTP/1.1\r\nHost: x\r\nContent-Length: {length}\r\n\r\n".encode()


async def test_what_is_not_there_is_told_as_everywhere(store: Running) -> None:
    for method, path, status in (("GET", "/", 404), ("PUT", "/experiments", 405), ("GET", "/experiments/x/y", 404)):
        answer = await store.http.request(method, path)
        assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")


def test_a_results_path_that_is_no_folder_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="Results cannot be kept in"), Workspace.opened(tmp_path / "file"):
        pass
