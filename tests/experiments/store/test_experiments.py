"""Experiments of the page, begun, extended, listed and removed, next to experiments of commands."""

from __future__ import annotations

import http.client
import json
from pathlib import Path

import anyio
import anyio.to_thread
import pytest

from tests.experiments.made_up import write_run
from tests.experiments.store.conftest import SCENE_BYTES, Running, by_command, plan, running_store, slug, upload
from tigas_experiments.lock import LOCK_NAME, hold_lock
from tigas_experiments.quality.picture import CaptureQuality
from tigas_experiments.records.folder import StoredRun, read_experiment, read_snapshot
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.summary import summarise
from tigas_experiments.wire.recording import Input, LinkSample, ShownFrame

pytestmark = pytest.mark.anyio


async def test_an_experiment_from_its_beginning_to_its_end(store: Running) -> None:
    begun = await store.http.post("/experiments", json=plan(" RTT & Größe ", repeats=2))
    experiment = begun.json()["id"]
    assert (begun.status_code, begun.headers["location"]) == (201, f"/experiments/{experiment}")
    assert experiment.startswith("RTT-Gr-e-20")
    row = await store.add(experiment)
    assert (row["status"], row["problem"]) == ("complete", None)
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert [(one["id"], one["name"], one["source"]) for one in listed] == [(experiment, "RTT & Größe", "page")]
    assert [(one["planned"], one["runs"], one["complete"]) for one in listed] == [(4, 1, 1)]
    told = (await store.http.get(f"/experiments/{experiment}")).json()
    assert (told["plan"]["repeats"], told["complete"], told["runs"]) == (2, 1, [row])
    assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204
    assert store.kept() == []
    for path in ("", "/zip", "/report"):
        answer = await store.http.get(f"/experiments/{experiment}{path}")
        assert (answer.status_code, answer.json()["type"]) == (404, "tigas:unknown-experiment")


async def test_experiments_of_one_name_are_told_apart(store: Running) -> None:
    for _ in range(3):
        await store.create("Pebbles")
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert sorted(one["name"] for one in listed) == ["Pebbles", "Pebbles (2)", "Pebbles (3)"]
    for _ in range(2):
        await store.create("x" * 100)
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert {"x" * 100, "x" * 96 + " (2)"} < {one["name"] for one in listed}


async def test_a_run_is_kept_as_commands_keep_theirs(store: Running) -> None:
    experiment = await store.create()
    row = await store.add(experiment, "dash-tuned")
    folder = store.results / experiment / "runs" / row["folder"]
    assert folder.name == "courtyard_stroll_20mbit-20ms-rtt_dash-tuned_0"
    stored = StoredRun(folder)
    assert (stored.record.started, stored.record.machine.system) == ("2001-09-09T01:46:40+00:00", "Linux 6")
    assert (stored.record.scene_bytes, stored.record.backend) == (SCENE_BYTES, "netem")
    assert (len(stored.read(Input)), len(stored.read(ShownFrame)), len(stored.read(LinkSample))) == (50, 50, 3)
    assert (stored.read(CaptureQuality), stored.read(LoadSample), read_snapshot(stored.folder)) == ([], [], None)
    figures = summarise(folder).figures
    assert figures is not None
    assert (figures.values["motion_to_photon_p50_ms"], figures.values["over_link_mbit_s"]) == (40, 5)
    assert read_experiment(store.results / experiment).source == "page"


async def test_a_run_gets_the_load_of_its_own_time(tmp_path: Path) -> None:
    busy = {-1: 0.1, 0: 0.5, 1000: 0.99, 2000: 0.1}  # the run lasts a second
    load = [LoadSample(unix_ms=1e12 + at, cpu=cpu, load_average=1.0) for at, cpu in busy.items()]
    async with running_store(tmp_path, load) as store:
        experiment = await store.create()
        row = await store.add(experiment)
        told = StoredRun(store.results / experiment / "runs" / row["folder"]).record.load
    assert told is not None
    assert told.cpu_mean == pytest.approx(0.745)
    assert told.cpu_max == 0.99
    assert row["saturated_share"] == 0.5


async def test_experiments_of_commands_are_there_as_they_grow(store: Running) -> None:
    folder = by_command(store.results / "by hand", 2)
    killed = folder / "runs" / "01" / "run.json"
    killed.write_text(json.dumps(json.loads(killed.read_text()) | {"status": "running"}))
    await store.create("younger")
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert [(one["name"], one["runs"], one["complete"]) for one in listed] == [("younger", 0, 0), ("by hand", 2, 1)]
    told = (await store.http.get("/experiments/by%20hand")).json()
    assert [(run["status"], run["problem"]) for run in told["runs"]] == [
        ("complete", None),
        ("running", "The run is incomplete: it did not finish."),
    ]
    write_run(folder / "runs" / "again", repeat=1)
    killed.write_text((folder / "runs" / "again" / "run.json").read_text())
    told = (await store.http.get("/experiments/by%20hand")).json()
    assert (told["complete"], [run["status"] for run in told["runs"]]) == (3, ["complete"] * 3)


@pytest.mark.parametrize(
    "content", ["", "{}", "[1]", "\xff", '{"name": "a", "created": "", "source": "cat", "plan": {}}']
)
async def test_what_cannot_be_read_costs_itself_alone(store: Running, content: str) -> None:
    good = await store.create()
    bad = store.results / "bad"
    by_command(bad, 1)
    (store.results / good / "runs" / "no-run").mkdir()
    (store.results / good / "runs" / "broken").mkdir()
    (store.results / good / "runs" / "broken" / "run.json").write_text(content, encoding="latin-1")
    (bad / "experiment.json").write_text(content, encoding="latin-1")
    (store.results / "not-an-experiment").mkdir()
    (store.results / "a-file").write_text("")
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert [(one["id"], one["runs"]) for one in listed] == [(good, 0)]
    for name in ("bad", "not-an-experiment", "a-file"):
        assert (await store.http.get(f"/experiments/{name}")).status_code == 404


async def test_what_a_command_makes_is_its_own(store: Running) -> None:
    folder = by_command(store.results / "made", 1)
    for answer in (
        await store.http.put(f"/experiments/made/runs/{slug()}", json=upload()),
        await store.http.post("/experiments/made/next", json={"page": "a"}),
    ):
        assert (answer.status_code, answer.json()["type"]) == (409, "tigas:experiment-in-use")
    assert len(list((folder / "runs").iterdir())) == 1
    with hold_lock(folder / LOCK_NAME, "busy"):
        refused = await store.http.delete("/experiments/made")
        assert (refused.status_code, refused.json()["type"]) == (409, "tigas:experiment-in-use")
        assert (folder / "experiment.json").is_file()
    assert (await store.http.delete("/experiments/made")).status_code == 204
    assert store.kept() == []


ELSEWHERE = [
    "..", ".", "%2e%2e", "%2E", "..%2foutside", "..%2Foutside", "%2e%2e%2foutside", "..%5coutside", "link", ".store",
    "%2fetc", "good%2f..%2f..%2foutside", "good%2fruns", "a%00b", "%00", "%ff%fe", "a" * 300, "%0a", "none",
    "..%252foutside",
]  # fmt: skip


def ask(port: int, method: str, path: str) -> tuple[int, bytes]:
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
    asked = [("GET", ""), ("GET", "/zip"), ("GET", "/report"), ("DELETE", ""), ("PUT", f"/runs/{slug()}")]
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
    added = await store.http.post(f"/experiments/{name}/runs/{slug()}/complete")
    assert added.status_code == 404
    assert [path.name for path in (outside / "runs").iterdir()] == ["00"]
    assert (await store.http.delete(f"/experiments/{name}")).status_code == 204
    assert (outside / "runs" / "00" / "run.json").is_file()
