"""A store on a free port, in this process, over an empty results directory."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple

import httpx
import pytest

from tests.experiments.made_up import MACHINE, SERVER, configuration, recording, sample, write_run
from tests.scenes import scene
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.offload import Limit, Offload
from tigas_common.origins import OriginPolicy
from tigas_common.runner import serve_http
from tigas_common.wire.render import SceneInfo, ServerConfig
from tigas_experiments.records.folder import ExperimentRecord, write_experiment
from tigas_experiments.records.load import LoadSample
from tigas_experiments.store.app import create_app
from tigas_experiments.store.main import open_store
from tigas_experiments.store.planner import Services
from tigas_experiments.store.workspace import NAME
from tigas_experiments.wire.run import Configuration, Mode

PATIENCE_S = 20
NOBODY = "http://127.0.0.1:9"
"""Where no render service is."""
SCENE_BYTES = 12_345
MADE = "2026-01-01T00:00:00+00:00"
T = TypeVar("T")
Ts = TypeVarTuple("Ts")


@dataclass
class Running:
    """A store, its directories, and a client of it."""

    results: Path
    movements: Path
    http: httpx.AsyncClient
    port: int

    async def create(self, name: str = "abr", **changes: Any) -> str:
        answer = await self.http.post("/experiments", json=plan(name, **changes))
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    async def next(self, experiment: str, page: str = "page-1", **changes: Any) -> dict[str, Any]:
        """The answer to a page that asks for a run."""
        answer = await self.http.post(f"/experiments/{experiment}/next", json={"page": page, **changes})
        assert answer.status_code == 200, answer.text
        told: dict[str, Any] = answer.json()
        return told

    async def add(self, experiment: str, mode: Mode = "stateless", **changes: Any) -> dict[str, Any]:
        """A new run's row, with everything that belongs to it."""
        path = f"/experiments/{experiment}/runs/{slug(mode)}"
        answer = await self.http.put(path, json=upload(mode, **changes))
        assert answer.status_code == 200, answer.text
        answer = await self.http.post(f"{path}/complete")
        assert answer.status_code == 200, answer.text
        row: dict[str, Any] = answer.json()
        return row

    def kept(self) -> list[str]:
        """Every file and folder, but for the lock."""
        paths = (str(path.relative_to(self.results)) for path in self.results.rglob("*"))
        return sorted(path for path in paths if path not in (NAME, f"{NAME}/lock"))


def plan(name: str = "abr", **changes: Any) -> dict[str, Any]:
    """The page's request for an experiment with a run of a second for each of two modes."""
    file = {
        "name": name,
        "scenes": ["courtyard"],
        "movements": ["stroll"],
        "networks": ["20mbit,20ms-rtt"],
        "modes": ["stateless", "dash-tuned"],
        "duration_s": 1,
        "shuffled": False,
    }
    return {"file": json.dumps(file | changes)}


def slug(mode: Mode = "stateless") -> str:
    """The folder of a run of that experiment."""
    return configuration(mode).slug


def upload(mode: Mode = "stateless", **changes: Any) -> dict[str, Any]:
    """The page's upload after a run, with changes of the recording."""
    return {
        "recording": recording(**{"mode": mode.partition("-")[0], "captures": [], **changes}),
        "link": [sample(at).model_dump() for at in (0.0, 500.0, 1000.0)],
        "backend": "netem",
    }


async def services(run: Configuration) -> tuple[ServerConfig, SceneInfo]:
    """A render service with a packager and any scene."""
    config = SERVER.model_copy(update={"services": {"dash": NOBODY}})
    return config, scene(id=run.scene, file_bytes=SCENE_BYTES)


async def in_a_thread(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
    """Replaces the worker process, which takes seconds to start."""
    return await asyncio.to_thread(function, *arguments)


POLICY = OriginPolicy(pages=("https://page.example",), on_network=True)


@asynccontextmanager
async def running_store(
    directory: Path,
    load: Sequence[LoadSample] = (),
    offload: Offload = in_a_thread,
    limits: HttpLimits = HttpLimits(),  # noqa: B008 - it is frozen
    policy: OriginPolicy = POLICY,
    services: Services = services,
    clock: Callable[[], float] = time.monotonic,
) -> AsyncIterator[Running]:
    results, movements = directory / "results", directory / "movements"
    movements.mkdir(exist_ok=True)
    async with (
        open_store(
            results, movements, NOBODY, machine=MACHINE, load=load, offload=offload, services=services, clock=clock
        ) as store,
        serve_http(create_app(store, policy), Address("127.0.0.1", 0), limits) as port,
        httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE_S) as client,
    ):
        yield Running(results, movements, client, port)


@pytest.fixture
async def store(tmp_path: Path) -> AsyncIterator[Running]:
    async with running_store(tmp_path) as running:
        yield running


def by_command(folder: Path, runs: int) -> Path:
    """An experiment as the command leaves it."""
    write_experiment(folder, ExperimentRecord(name="by hand", created=MADE, source="command", plan={"seed": 2}))
    for number in range(runs):
        write_run(folder / "runs" / f"{number:02}", repeat=number)
    return folder
