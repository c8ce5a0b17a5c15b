"""One run with a made-up page: its record, and reasons for failure."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.experiments.made_up import MACHINE, SERVER, STREAM, configuration, recording
from tests.scenes import scene
from tigas_common.errors import StartError
from tigas_experiments.errors import RunFailed
from tigas_experiments.records.files import parse_recording
from tigas_experiments.records.folder import InputDigests, RunRecord, StoredRun
from tigas_experiments.records.load import LoadSample
from tigas_experiments.records.machine import Server
from tigas_experiments.run import measure as run_module
from tigas_experiments.run.environment import RunSetup
from tigas_experiments.run.inputs import Inputs, points_sha256
from tigas_experiments.run.job import RunSources
from tigas_experiments.run.targets import Target
from tigas_experiments.wire.recording import Recording, ShownFrame
from tigas_experiments.wire.run import Configuration, Network, RunPlan

UNSHAPED = configuration(network=Network(), warm_up_s=0.0)
POINTS = Inputs(Path()).points(UNSHAPED, scene())
DIGESTS = InputDigests(movement="a", trace="b")


class World:
    """An environment, its page and its services; a test injects faults."""

    machine = MACHINE

    def __init__(self) -> None:
        self.recording: dict[str, Any] = recording()
        self.fault: str | None = None
        self.url = "http://127.0.0.1:9"
        self.scene = scene()
        self.enhances = True
        self.can_start = True
        self.asked: dict[str, Any] = {}

    async def setup(self, _: object) -> RunSetup:
        if not self.can_start:
            raise StartError("The lab did not start: no.")
        return RunSetup(
            target=Target(self.url, SERVER),
            browser=SimpleNamespace(version="1"),  # type: ignore[arg-type]
            points=POINTS,
            network=UNSHAPED.network,
            made_from=RunSources(DIGESTS, points_sha256(POINTS), SERVER, self.scene),
        )

    async def prepare(self, settings: object, pose: object) -> None:
        self.asked |= {"pose": pose, "settings": settings}

    async def record(self, plan: RunPlan, patience_s: float) -> Recording:
        self.asked |= plan.model_dump()
        return parse_recording(json.dumps(self.recording))

    async def check(self) -> None:
        if not self.enhances:
            raise RunFailed("Frames are not shown as they should be: it took 40 ms a frame.")


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World()

    @asynccontextmanager
    async def viewer(*_: object) -> AsyncIterator[World]:
        yield made

    async def fault(_: object) -> str | None:
        return made.fault

    monkeypatch.setattr(run_module, "open_viewer", viewer)
    monkeypatch.setattr(run_module, "find_fault", fault)
    return made


def run(world: World, folder: Path, asked: Configuration = UNSHAPED) -> RunRecord:
    """Make it; returns the written record."""
    environment: Any = world
    record = asyncio.run(run_module.measure_run(environment, asked, folder, lambda _: None))
    assert StoredRun(folder).record == record
    return record


def test_the_record_says_which_poses_the_page_was_given(world: World, tmp_path: Path) -> None:
    first, second = (run(world, tmp_path / name) for name in ("first", "second"))
    assert first.status == "complete"
    assert world.asked["pose"] == POINTS[0]
    assert list(world.asked["points"]) == POINTS
    assert first.points_sha256 == second.points_sha256 == points_sha256(POINTS)
    assert (first.scene_bytes, first.scene_sha256) == (scene().file_bytes, scene().file_sha256)


def test_the_record_says_what_it_was_made_from_and_with(world: World, tmp_path: Path) -> None:
    record = run(world, tmp_path / "run")
    assert record.inputs_sha256 == DIGESTS
    assert record.server == Server(
        version="9", commit="abc", device="GPU", tcp_congestion_control="cubic", ladder=SERVER.ladder
    )
    world.scene = world.scene.model_copy(update={"ladder": SERVER.ladder[1:]})
    of_its_own = run(world, tmp_path / "of its own").server
    assert of_its_own is not None
    assert of_its_own.ladder == SERVER.ladder[1:]


def test_the_record_has_the_load_and_says_if_services_were_elsewhere(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = parse_recording(json.dumps(world.recording)).started_unix_ms

    @asynccontextmanager
    async def watching_load(render: str, processes: object) -> AsyncIterator[list[LoadSample]]:
        shares = {-1.0: 0.0, 0.0: 0.95, 1.0: 0.5}
        yield [
            LoadSample(unix_ms=start + at, cpu=0.5, threads={"chromium": share}, load_average=1.0)
            for at, share in shares.items()
        ]

    monkeypatch.setattr(run_module, "monitor_load", watching_load)
    world.url = "http://192.0.2.1:8080"
    load = run(world, tmp_path / "run").load
    assert load is not None
    assert (load.pegged, load.services) == ({"chromium": 0.5}, "elsewhere")


def test_a_download_begins_with_the_recording(world: World, tmp_path: Path) -> None:
    asked = configuration("local-compressed", network=Network(), warm_up_s=0.0)
    assert run(world, tmp_path / "run", asked).status == "complete"
    assert world.asked["settings"]["mode"] == "stateless"
    assert world.asked["download"] is True


def test_a_service_that_ended_meanwhile_costs_the_run(world: World, tmp_path: Path) -> None:
    world.fault = "A service of the lab has ended: process 1."
    record = run(world, tmp_path / "run")
    assert (record.status, record.problem) == ("failed", world.fault)
    assert StoredRun(tmp_path / "run").read(ShownFrame), "what was recorded is kept"


def test_services_that_do_not_start_again_cost_the_run(world: World, tmp_path: Path) -> None:
    world.can_start = False
    assert run(world, tmp_path / "run").problem == "The lab did not start: no."


def test_models_that_were_given_up_meanwhile_cost_the_run(world: World, tmp_path: Path) -> None:
    world.enhances = False
    record = run(world, tmp_path / "run")
    assert record.problem == "Frames are not shown as they should be: it took 40 ms a frame."


@pytest.mark.parametrize(
    ("protocols", "problem"),
    [
        (["h3"], None),
        (["h3", "http/1.1"], "Segments came over h3 and http/1.1 instead of HTTP/3."),
        ([], "Segments came over nothing known instead of HTTP/3."),
    ],
)
def test_a_run_over_http3_had_all_segments_over_it(
    world: World, tmp_path: Path, protocols: list[str], problem: str | None
) -> None:
    world.recording |= {"mode": "dash", "dash": STREAM.model_dump(mode="json") | {"protocols": protocols}}
    asked = UNSHAPED.model_copy(update={"mode": "dash-edge", "dash_transport": "h3"})
    assert run(world, tmp_path / "h3", asked).problem == problem
    assert run(world, tmp_path / "tcp", asked.model_copy(update={"dash_transport": "tcp"})).problem is None


def test_a_recording_that_is_none_costs_the_run(world: World, tmp_path: Path) -> None:
    world.recording |= {"frames": [{}]}
    record = run(world, tmp_path / "run")
    assert record.status == "failed"
    assert "The page's recording cannot be used: frames.0" in str(record.problem)
