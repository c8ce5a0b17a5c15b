"""Experiments as the page meets them: begun, added to, listed, removed; and those of commands beside them."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tests.experiments.store.conftest import SCENE_BYTES, Running, running_store, upload
from tigas_experiments.records.folder import ExperimentRecord, StoredRun, read_experiment, write_experiment
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.summary import summarise
from tigas_experiments.run.lock import EXPERIMENT, exclusive

pytestmark = pytest.mark.anyio
MADE = "2026-01-01T00:00:00+00:00"


def by_command(folder: Path, runs: int) -> Path:
    """An experiment as the command leaves it."""
    write_experiment(folder, ExperimentRecord(name="by hand", created=MADE, source="command", plan={"seed": 2}))
    for number in range(runs):
        write_run(folder / "runs" / f"{number:02}", repeat=number)
    return folder


async def test_an_experiment_from_its_beginning_to_its_end(store: Running) -> None:
    plan = {"modes": ["stateless"], "rtts_ms": [20, 50.5], "seed": None}
    begun = await store.http.post("/experiments", json={"name": " RTT & Größe ", "plan": plan, "planned": 3})
    experiment = begun.json()["id"]
    assert (begun.status_code, begun.headers["location"]) == (201, f"/experiments/{experiment}")
    assert experiment.startswith("RTT-Gr-e-20")
    row = await store.add(experiment)
    assert (row["status"], row["problem"], row["figures"]["latencies"]["p50"]) == ("complete", None, 40)
    assert row["figures"]["delivered_kbps"] == 5000
    listed = (await store.http.get("/experiments")).json()["experiments"]
    assert [(one["id"], one["name"], one["source"]) for one in listed] == [(experiment, "RTT & Größe", "page")]
    assert [(one["planned"], one["runs"], one["complete"]) for one in listed] == [(3, 1, 1)]
    told = (await store.http.get(f"/experiments/{experiment}")).json()
    assert (told["plan"], told["complete"], told["runs"]) == (plan, 1, [row])
    assert (await store.http.delete(f"/experiments/{experiment}")).status_code == 204
    assert store.kept() == []
    for path in ("", "/zip", "/report"):
        answer = await store.http.get(f"/experiments/{experiment}{path}")
        assert (answer.status_code, answer.json()["type"]) == (404, "tigas:unknown-experiment")


async def test_a_run_is_kept_as_commands_keep_theirs(store: Running) -> None:
    experiment = await store.create()
    row = await store.add(experiment, "dash-tuned")
    folder = store.results / experiment / "runs" / row["folder"]
    assert folder.name == "courtyard_stroll_20mbit-20ms-rtt_dash-tuned_0"
    stored = StoredRun(folder)
    assert (stored.record.started, stored.record.machine.system) == ("2001-09-09T01:46:40+00:00", "Linux 6")
    assert stored.record.scene_bytes == SCENE_BYTES
    assert (len(stored.inputs()), len(stored.frames()), len(stored.link())) == (50, 50, 3)
    assert (stored.quality(), stored.load(), stored.moment()) == ([], [], None)
    figures = summarise(folder).figures
    assert figures is not None
    assert json.loads(figures.model_dump_json()) == row["figures"]
    assert read_experiment(store.results / experiment).source == "page"


async def test_a_run_that_broke_off_is_kept_as_failed(store: Running) -> None:
    experiment = await store.create()
    row = await store.add(experiment, complete=False)
    assert (row["status"], row["figures"]) == ("failed", None)
    assert row["problem"] == "The movement was not played to its end."
    [listed] = (await store.http.get("/experiments")).json()["experiments"]
    assert (listed["planned"], listed["runs"], listed["complete"]) == (None, 1, 0), "nobody said how many there will be"


async def test_a_run_gets_the_load_of_its_own_time(tmp_path: Path) -> None:
    busy = {-1: 0.1, 0: 0.5, 1000: 0.7, 2000: 0.1}  # the run lasts a second
    load = [LoadSample(unix_ms=1e12 + at, cpu=cpu, load_average=1.0) for at, cpu in busy.items()]
    async with running_store(tmp_path, load) as store:
        experiment = await store.create()
        row = await store.add(experiment)
        told = StoredRun(store.results / experiment / "runs" / row["folder"]).record.load
    assert told is not None
    assert told.cpu_mean == pytest.approx(0.6)
    assert told.cpu_max == 0.7


async def test_equal_runs_and_equal_names_are_all_kept(store: Running) -> None:
    experiments = await asyncio.gather(*(store.create("twice") for _ in range(4)))
    assert len(set(experiments)) == 4
    slug = "courtyard_stroll_20mbit-20ms-rtt_stateless-budget_0"
    (store.results / experiments[0] / "runs" / slug).write_text("a file in the way")
    rows = await asyncio.gather(*(store.add(experiments[0]) for _ in range(4)))
    assert {row["folder"] for row in rows} == {f"{slug}_{number}" for number in range(2, 6)}
    told = (await store.http.get(f"/experiments/{experiments[0]}")).json()
    assert sorted(run["folder"] for run in told["runs"]) == sorted(row["folder"] for row in rows)


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
        ("running", "The run is incomplete: it was never ended."),
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
    added = await store.http.post("/experiments/made/runs", json=upload())
    assert (added.status_code, added.json()["type"]) == (409, "tigas:experiment-in-use")
    assert len(list((folder / "runs").iterdir())) == 1
    with exclusive(folder / EXPERIMENT, "busy"):
        refused = await store.http.delete("/experiments/made")
        assert (refused.status_code, refused.json()["type"]) == (409, "tigas:experiment-in-use")
        assert (folder / "experiment.json").is_file()
    assert (await store.http.delete("/experiments/made")).status_code == 204
    assert store.kept() == []


PAGES = {
    None: 201,
    "http://127.0.0.1:8080": 201,
    "http://localhost:8080": 201,
    "https://page.example": 201,
    "https://evil.example": 403,
    "http://127.0.0.1.evil.example": 403,
    "null": 403,
    "http://[": 403,
}


async def test_only_the_labs_page_may_change_experiments(store: Running) -> None:
    for origin, wanted in PAGES.items():
        headers = {} if origin is None else {"origin": origin}
        experiment = await store.create()
        made = await store.http.post("/experiments", json={"name": "a", "plan": {}}, headers=headers)
        added = await store.http.post(f"/experiments/{experiment}/runs", json=upload(), headers=headers)
        removed = await store.http.delete(f"/experiments/{experiment}", headers=headers)
        assert (made.status_code, added.status_code) == (wanted, wanted), origin
        assert removed.status_code == (204 if wanted == 201 else 403), origin
        assert (store.results / experiment).is_dir() == (wanted == 403)
        assert wanted == 201 or removed.json()["type"] == "tigas:foreign-origin"


@pytest.mark.parametrize(
    ("host", "status"), [("evil.example", 403), ("labhost", 201), ("lab.local", 201), ("10.1.2.3", 201)]
)
async def test_a_name_that_is_made_to_lead_here_is_foreign(store: Running, host: str, status: int) -> None:
    headers = {"host": f"{host}:8091", "origin": f"http://{host}:8080"}
    made = await store.http.post("/experiments", json={"name": "a", "plan": {}}, headers=headers)
    assert made.status_code == status


async def test_the_page_may_ask_across_origins(store: Running) -> None:
    page = "http://localhost:8080"
    asked = {"origin": page, "access-control-request-headers": "content-type"}
    for method in ("POST", "DELETE"):
        answer = await store.http.options("/experiments/x", headers=asked | {"access-control-request-method": method})
        assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (200, "*")
    assert (await store.http.get("/healthz", headers={"origin": page})).headers["access-control-allow-origin"] == "*"
    refused = await store.http.get("/experiments/x", headers={"origin": page})
    assert refused.headers["access-control-allow-origin"] == "*", "the page cannot read why"
