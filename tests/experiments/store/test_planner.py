"""Experiments that pages perform: files expanded, runs reserved, released, failed, and completed with captures."""

from __future__ import annotations

import asyncio
import errno
import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, TypeVarTuple

import pytest

from tests.experiments.made_up import SERVER, png
from tests.experiments.store.conftest import Running, in_a_thread, plan, running_store, services, slug, upload
from tests.scenes import scene
from tigas_common.errors import StartError
from tigas_common.offload import Limit
from tigas_common.wire.render import SceneInfo, ServerConfig
from tigas_experiments.quality.ground_truth import GroundTruth
from tigas_experiments.quality.picture import CaptureQuality, decode
from tigas_experiments.records.folder import StoredRun, read_snapshot
from tigas_experiments.run.experiment import GIVE_UP_AFTER
from tigas_experiments.store import app, planner
from tigas_experiments.store.planner import LEASE_S
from tigas_experiments.wire.recording import Input
from tigas_experiments.wire.run import Configuration

pytestmark = pytest.mark.anyio
T = TypeVar("T")
Ts = TypeVarTuple("Ts")
WALK = "# anchor: start\nt_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n{end},1,0,0,0,0,0,1\n"
TOML = 'name = "abr"\nscenes = ["courtyard"]\nmovements = ["stroll"]\nnetworks = ["unshaped"]\n'


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
async def timed(tmp_path: Path, clock: Clock) -> AsyncIterator[Running]:
    """A store with a clock of the test."""
    async with running_store(tmp_path, clock=clock) as store:
        yield store


def job_of(told: dict[str, Any]) -> str | None:
    return None if told["job"] is None else str(told["job"]["run"])


async def test_a_file_is_summarised_as_toml_and_as_json(store: Running) -> None:
    for file in (TOML, json.dumps(json.loads(plan()["file"]) | {"modes": ["stateless"], "duration_s": 20})):
        answer = await store.http.post("/plans", json={"file": file})
        assert answer.json() == {"runs": 1, "lasting": "25 seconds", "problem": None}
    assert store.kept() == []


async def test_files_are_expanded_in_turn(tmp_path: Path) -> None:
    """Each may take a gigabyte of memory."""
    working, most = 0, 0

    async def counted(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
        nonlocal working, most
        working, most = working + 1, max(most, working + 1)
        try:
            return await in_a_thread(function, *arguments)
        finally:
            working -= 1

    async with running_store(tmp_path, offload=counted) as store:
        asked = [store.http.post(path, json={"file": TOML}) for path in ("/plans", "/experiments") * 3]
        answers = await asyncio.gather(*asked)
    assert {answer.status_code for answer in answers} <= {200, 201}
    assert most == 1


MANY = [f"c{number}" for number in range(1000)]
HOSTILE: list[tuple[str, str]] = [
    ("{", "The file is not JSON"),
    ("name = ", "The file is not TOML"),
    ("[" * 50_000, "The file is not TOML"),
    ('{"name": ' + "[" * 50_000, "The file is not JSON"),
    (TOML.replace("stroll", "../../etc/passwd"), "must not be a path"),
    (TOML.replace("unshaped", "../x.csv"), "must not be a path"),
    (TOML.replace("stroll", "walk.csv"), "There is no movement 'walk.csv'"),
    (TOML + f"controllers = {[*MANY, 'more']}", "there are 1001; the limit is 1000"),
    (TOML + f"controllers = {MANY}\n" + "[[variants]]\noverscan = 0.1\n" * 101, "variants"),
    (
        TOML
        + f"controllers = {MANY}\n"
        + "".join(f'[[variants]]\nmodes = ["video"]\noverscan = {n / 1000}\n' for n in range(99)),
        "more than 10000 runs",
    ),
]


@pytest.mark.parametrize(("file", "told"), HOSTILE)
async def test_a_file_that_makes_no_sense_is_told_why(store: Running, file: str, told: str) -> None:
    summary = (await store.http.post("/plans", json={"file": file})).json()
    answer = await store.http.post("/experiments", json={"file": file})
    assert (answer.status_code, answer.json()["type"]) == (400, "tigas:invalid-request")
    assert summary == {"runs": 0, "lasting": "", "problem": answer.json()["detail"]}
    assert told in summary["problem"]
    assert len(summary["problem"]) < 1000
    assert store.kept() == []


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (b"", "invalid JSON"),
        (b"{}", "file"),
        (b'{"file": "\\ud800"}', "invalid JSON"),
        (b'{"file": "", "movements": {"a.csv": 1}}', "movements"),
        (b'{"file": "", "traces_s": {"a": -1}}', "traces_s"),
        (json.dumps({"file": "x" * 100_001}).encode(), "file"),
    ],
)
async def test_a_broken_request_is_told_why(store: Running, body: bytes, told: str) -> None:
    answer = await store.http.post("/plans", content=body)
    assert answer.status_code == 400
    assert told.lower() in answer.json()["detail"].lower()


async def test_movements_come_with_the_request_or_from_the_store(store: Running) -> None:
    (store.movements / "turn.csv").write_text(WALK.format(end=2000))
    wanted = plan(movements=["turn.csv", "walk.csv", "stroll"]) | {"movements": {"walk.csv": WALK.format(end=3000)}}
    experiment = (await store.http.post("/experiments", json=wanted)).json()["id"]
    inputs = store.results / experiment / "inputs"
    assert sorted(path.name for path in inputs.iterdir()) == ["turn.csv", "walk.csv"]
    (store.movements / "turn.csv").unlink()
    told = await store.next(experiment, begin=True)
    assert told["planned"] == 6
    points = told["job"]["plan"]["points"]
    assert points[0]["t_ms"] == 0
    (store.movements / "turn.csv").write_text(WALK.format(end=2000))
    for text, sentence in ((WALK.format(end=500), "lasts 0.5 s, less than a run's 1 s"), ("t_ms,x\n1,2\n", "walk.csv")):
        refused = await store.http.post("/plans", json=wanted | {"movements": {"walk.csv": text}})
        assert sentence in refused.json()["problem"]


async def test_segments_of_the_shapers_traces_need_their_durations(store: Running) -> None:
    wanted = plan(networks=["stairs"], segments=2, modes=["stateless"]) | {"traces_s": {"stairs": 30.0}}
    experiment = (await store.http.post("/experiments", json=wanted)).json()["id"]
    offsets = []
    for _ in range(2):
        job = (await store.next(experiment))["job"]
        offsets.append(job["configuration"]["network"]["offset_s"])
        run = f"/experiments/{experiment}/runs/{job['run']}"
        await store.http.put(run, json=upload())
        assert (await store.http.post(f"{run}/complete")).json()["status"] == "complete"
    assert 0 <= offsets[0] < 29
    assert abs(offsets[0] - offsets[1]) >= 1
    short = wanted | {"traces_s": {"stairs": 1.5}}
    assert "room for 1 segments" in (await store.http.post("/plans", json=short)).json()["problem"]


async def test_a_page_performs_one_run_after_the_other(store: Running) -> None:
    experiment = await store.create()
    first = await store.next(experiment, begin=True)
    assert (job_of(first), first["planned"], first["missing"], first["wait"]) == (slug(), 2, 2, False)
    assert first["remaining_s"] == 12
    job = first["job"]
    assert job["title"] == "Stateless seen, 20mbit,20ms-rtt, stroll"
    assert job["settings"]["controller"] == "seen"
    assert job["settings"]["seed"] == 1
    assert (job["plan"]["duration_ms"], job["plan"]["download"], len(job["plan"]["points"])) == (1000, False, 61)
    await store.add(experiment)
    second = await store.next(experiment)
    assert (job_of(second), second["missing"]) == (slug("dash-tuned"), 1)
    await store.add(experiment, "dash-tuned")
    last = await store.next(experiment)
    assert last == {"job": None, "planned": 2, "missing": 0, "remaining_s": 0, "wait": False, "problem": None}
    again = await store.http.put(f"/experiments/{experiment}/runs/{slug()}", json=upload())
    assert (again.status_code, again.json()["type"]) == (409, "tigas:run-complete")
    unknown = await store.http.put(f"/experiments/{experiment}/runs/other", json=upload())
    assert (unknown.status_code, unknown.json()["type"]) == (404, "tigas:unknown-run")


async def test_pages_share_runs_that_need_no_link(timed: Running, clock: Clock) -> None:
    experiment = await timed.create(networks=["unshaped"])
    assert job_of(await timed.next(experiment, "a", begin=True)) == "courtyard_stroll_unshaped_stateless-seen_0"
    assert job_of(await timed.next(experiment, "b", begin=True)) == "courtyard_stroll_unshaped_dash-tuned_0"
    third = await timed.next(experiment, "c")
    assert (job_of(third), third["wait"]) == (None, True)
    assert (await timed.http.delete(f"/experiments/{experiment}/pages/b")).status_code == 204
    assert job_of(await timed.next(experiment, "c")) == "courtyard_stroll_unshaped_dash-tuned_0"
    clock.now = LEASE_S + 3.5  # a page that was killed gives nothing back
    assert job_of(await timed.next(experiment, "d")) is None
    clock.now += 1
    assert job_of(await timed.next(experiment, "d")) == "courtyard_stroll_unshaped_stateless-seen_0"


async def test_a_shaped_link_is_of_one_page_at_a_time(timed: Running) -> None:
    first, second = await timed.create(), await timed.create()
    assert job_of(await timed.next(first, "a")) == slug()
    told = await timed.next(second, "b")
    assert (job_of(told), told["wait"]) == (None, True)
    await timed.http.delete(f"/experiments/{first}/pages/a")
    assert job_of(await timed.next(second, "b")) == slug()


@pytest.mark.parametrize("networks", [("20mbit", "unshaped"), ("unshaped", "20mbit")])
async def test_a_run_without_a_link_does_not_end_another_page_s_link(timed: Running, networks: tuple[str, str]) -> None:
    first, second = [await timed.create(networks=[network]) for network in networks]
    assert job_of(await timed.next(first, "a")) is not None
    told = await timed.next(second, "b")
    assert (job_of(told), told["wait"]) == (None, True)


async def test_an_experiment_that_is_removed_gives_the_link_back(timed: Running) -> None:
    first, second = await timed.create(), await timed.create()
    assert job_of(await timed.next(first, "a")) == slug()
    assert (await timed.http.delete(f"/experiments/{first}")).status_code == 204
    assert job_of(await timed.next(second, "b")) == slug()


async def fail(store: Running, experiment: str, run: str) -> None:
    answer = await store.http.put(f"/experiments/{experiment}/runs/{run}", json={"problem": "The connection was lost."})
    assert (answer.json()["status"], answer.json()["problem"]) == ("failed", "The connection was lost.")


async def test_a_failed_run_is_tried_again_when_a_page_begins_anew(store: Running) -> None:
    experiment = await store.create()
    await store.next(experiment, begin=True)
    await fail(store, experiment, slug())
    assert job_of(await store.next(experiment)) == slug("dash-tuned")
    await store.add(experiment, "dash-tuned")
    told = await store.next(experiment)
    assert (job_of(told), told["wait"], told["missing"], told["problem"]) == (None, False, 1, None)
    assert job_of(await store.next(experiment, begin=True)) == slug()
    await store.add(experiment)
    folder = store.results / experiment
    assert StoredRun(folder / "earlier" / f"{slug()}.1").record.problem == "The connection was lost."
    assert [path.name for path in (folder / "runs").iterdir() if path.name == slug()] == [slug()]


async def test_many_failures_in_a_row_end_it(store: Running) -> None:
    experiment = await store.create(repeats=4)
    for _ in range(GIVE_UP_AFTER):
        run = job_of(await store.next(experiment))
        assert run is not None
        await fail(store, experiment, run)
    told = await store.next(experiment)
    assert (job_of(told), told["wait"]) == (None, False)
    assert told["problem"].startswith("5 runs in a row failed, so the others are not tried.")
    assert told["problem"].endswith("The connection was lost.")
    assert job_of(await store.next(experiment, begin=True)) is not None


# While the body is received, and while the run is moved to its place.
@pytest.mark.parametrize(("module", "function"), [(app, "_receive"), (planner, "_place")])
async def test_a_full_disk_fails_its_run_and_many_end_it(
    store: Running, module: ModuleType, function: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module, function, full)
    experiment = await store.create(repeats=GIVE_UP_AFTER)
    tried = set()
    for _ in range(GIVE_UP_AFTER):
        run = job_of(await store.next(experiment))
        assert run is not None
        tried.add(run)
        body = {"problem": "The store's disk is full."}
        for _ in range(2):  # it is counted once
            assert (await store.http.put(f"/experiments/{experiment}/runs/{run}", json=body)).status_code == 507
    assert len(tried) == GIVE_UP_AFTER
    told = (await store.next(experiment))["problem"]
    assert "5 runs in a row failed" in told
    assert told.endswith("The disk that holds the results is full.")


async def test_one_that_was_ended_by_failures_begins_anew_after_a_page_has_died(timed: Running, clock: Clock) -> None:
    experiment = await timed.create(repeats=4, networks=["unshaped"])
    await timed.next(experiment, "dead", begin=True)
    for _ in range(GIVE_UP_AFTER):
        run = job_of(await timed.next(experiment, "a"))
        assert run is not None
        await fail(timed, experiment, run)
    assert job_of(await timed.next(experiment, "a", begin=True)) is None, "the other page may still be measuring"
    clock.now = LEASE_S + 10
    assert job_of(await timed.next(experiment, "a", begin=True)) is not None


async def test_an_experiment_outlives_its_store(tmp_path: Path) -> None:
    async with running_store(tmp_path) as store:
        experiment = await store.create()
        await store.add(experiment)
        assert job_of(await store.next(experiment, begin=True)) == slug("dash-tuned")
    async with running_store(tmp_path) as store:
        told = await store.next(experiment, "other", begin=True)
        assert (job_of(told), told["missing"]) == (slug("dash-tuned"), 1)
        record = store.results / experiment / "experiment.json"
        record.write_text(json.dumps(json.loads(record.read_text()) | {"plan": {"profiles": ["latency"]}}))
    async with running_store(tmp_path) as store:
        refused = await store.http.post(f"/experiments/{experiment}/next", json={"page": "a"})
        assert (refused.status_code, refused.json()["type"]) == (400, "tigas:invalid-request")
        assert "Another version made this experiment" in refused.json()["detail"]


async def test_what_the_services_lack_is_told_before_the_first_run(tmp_path: Path) -> None:
    async def without_packager(run: Configuration) -> tuple[ServerConfig, SceneInfo]:
        if run.scene == "gone":
            raise StartError("The scene 'gone' cannot be loaded: no.")
        return SERVER, scene()

    async with running_store(tmp_path, services=without_packager) as store:
        for scene_id, told in (
            ("courtyard", "There is no packager behind"),
            ("gone", "The scene 'gone' cannot be loaded"),
        ):
            experiment = await store.create(scenes=[scene_id])
            refused = await store.http.post(f"/experiments/{experiment}/next", json={"page": "a", "begin": True})
            assert (refused.status_code, refused.json()["type"]) == (409, "tigas:cannot-start")
            assert told in refused.json()["detail"]


async def test_other_versions_are_told_before_an_experiment_goes_on(tmp_path: Path) -> None:
    async with running_store(tmp_path) as store:
        experiment = await store.create()
        await store.add(experiment)

    async def newer(run: Configuration) -> tuple[ServerConfig, SceneInfo]:
        config, found = await services(run)
        return config.model_copy(update={"commit": "abd"}), found

    async with running_store(tmp_path, services=newer) as store:
        refused = await store.http.post(f"/experiments/{experiment}/next", json={"page": "a", "begin": True})
        assert (refused.status_code, refused.json()["type"]) == (409, "tigas:versions-changed")
        assert "another render service's commit (abc, now abd)" in refused.json()["detail"]
        assert job_of(await store.next(experiment, begin=True, allow_changes=True)) == slug("dash-tuned")


CAPTURE = {"at": 500.0, "shown_at": 490.0, "pose": 20, "view": None, "rung": 2, "width": 64, "height": 36}


async def test_captures_are_compared_with_ground_truth(store: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    async def render(*_: object) -> Any:
        return decode(png(100))

    experiment = await store.create()
    run = f"/experiments/{experiment}/runs/{slug()}"
    folder = store.results / experiment / "runs" / slug()
    kept = await store.http.put(run, json=upload(captures=[CAPTURE]))
    assert (kept.json()["status"], kept.json()["problem"]) == ("running", "The run is incomplete: it did not finish.")
    odd = (
        ("0120.png", png()),
        ("0.png", png()),
        ("0000.jpg", png()),
        ("%00.png", png()),
        ("%2e%2e", png()),
        ("%E2%82%AC" * 90, png()),
    )
    for name, content in (("0000.png", png()[:-4]), *odd):
        assert (await store.http.put(f"{run}/captures/{name}", content=content)).status_code == 400
    assert (await store.http.put(f"{run}/captures/0000.png", content=png(100))).status_code == 204
    monkeypatch.setattr(GroundTruth, "_render", render)
    first = asyncio.create_task(store.http.post(f"{run}/complete"))
    again = await store.http.post(f"{run}/complete")  # as by a page that lost its connection meanwhile
    row = (await first).json()
    assert row["status"] == "complete"
    assert again.json() == row
    assert (await store.http.post(f"{run}/complete")).json() == row
    (compared,) = StoredRun(folder).read(CaptureQuality)
    assert compared.seen is not None
    assert compared.seen.psnr_db == 100
    assert read_snapshot(folder) is not None
    late = await store.http.put(f"{run}/captures/0000.png", content=png())
    assert (late.status_code, late.json()["type"]) == (409, "tigas:run-complete")


async def test_a_run_without_its_captures_or_ground_truth_fails(store: Running) -> None:
    experiment = await store.create()
    run = f"/experiments/{experiment}/runs/{slug()}"
    await store.http.put(run, json=upload(captures=[CAPTURE]))
    row = (await store.http.post(f"{run}/complete")).json()
    assert row["status"] == "failed"
    assert "0000.png cannot be read" in row["problem"]
    await store.http.put(run, json=upload(captures=[CAPTURE]))
    await store.http.put(f"{run}/captures/0000.png", content=png())
    row = (await store.http.post(f"{run}/complete")).json()
    assert row["problem"].startswith("Ground truth could not be rendered")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"complete": False}, "The movement was not played to its end."),
        ({"complete": False, "hidden": True}, "The page was hidden during the run."),
        ({"frames": []}, "No frame arrived during the run."),
    ],
)
async def test_a_recording_that_is_no_measurement_fails_its_run(
    store: Running, changes: dict[str, Any], told: str
) -> None:
    experiment = await store.create()
    row = await store.add(experiment, **changes)
    assert (row["status"], row["problem"]) == ("failed", told)
    assert StoredRun(store.results / experiment / "runs" / slug()).read(Input), "the recording is kept"
    assert job_of(await store.next(experiment)) == slug("dash-tuned")
