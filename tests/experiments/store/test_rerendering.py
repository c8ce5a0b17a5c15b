"""Samples of stored experiments, rendered again by the store, with progress and results."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.experiments.samples.renderers import FakeRenderer, patient_client, picture, sampled_run
from tests.experiments.store.conftest import NOBODY, PATIENCE_S, Running, by_command, running_store
from tigas_common.render_requests import RenderClient
from tigas_experiments.records.samples import JPEG, TRUTH, sample_path, write_sample_file
from tigas_experiments.store.experiments import run_version

pytestmark = pytest.mark.anyio
ASK = "/experiments/mine/materialise"


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch) -> FakeRenderer:
    made = FakeRenderer()
    answers_with(monkeypatch, made)
    return made


def answers_with(monkeypatch: pytest.MonkeyPatch, renderer: FakeRenderer) -> None:
    @asynccontextmanager
    async def at(_: type[RenderClient], url: str) -> AsyncIterator[RenderClient]:
        async with renderer.client() as client:
            yield client

    monkeypatch.setattr(RenderClient, "connect", classmethod(at))


@pytest.fixture
def run(store: Running) -> Path:
    """Of an experiment that a command made: samples 3 and 12, and a run without any."""
    folder = by_command(store.results / "mine", 1)
    sampled_run(folder / "runs" / "sampled", [12, 3])
    return folder / "runs" / "sampled"


async def ended(store: Running) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        told: dict[str, Any] = (await store.http.get(ASK)).json()
        if told["state"] == "idle":
            return told
        assert time.monotonic() < deadline, "it does not end"
        await asyncio.sleep(0.01)


async def test_samples_are_rendered_again_when_somebody_asks(store: Running, run: Path, renderer: FakeRenderer) -> None:
    (summary,) = (await store.http.get("/experiments")).json()["experiments"]
    assert (summary["runs"], summary["sampled"]) == (2, 1)
    assert (await store.http.get(ASK)).json() == {"state": "idle", "done": 0, "total": 2, "problem": None}
    before = run_version(run)
    begun = await store.http.post(ASK)
    assert (begun.status_code, begun.json()["state"], begun.json()["total"]) == (202, "running", 2)
    assert await ended(store) == {"state": "idle", "done": 2, "total": 2, "problem": None}
    old, sampled = (await store.http.get("/experiments/mine")).json()["runs"]
    assert old["samples"] is None
    assert sampled["samples"] == {"samples": 2, "identical": 2, "different": 0, "missing": 0}
    assert run_version(run) != before, "a report is made anew"


async def test_samples_are_listed_by_time_with_their_pictures(
    store: Running, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers_with(monkeypatch, FakeRenderer(shade=50))
    await store.http.post(ASK)
    await ended(store)
    sample_path(run, 12, JPEG).unlink()
    listed = (await store.http.get("/experiments/mine/runs/sampled/samples")).json()
    assert listed["problem"] is None
    first, second = listed["samples"]
    names = ("original", "enhanced", "truth", "replayed", "identical", "problem")
    assert (first["seq"], second["seq"]) == (3, 12)
    assert [first[name] for name in names] == [
        *("000003.jpg", None, "000003.truth.png", "000003.replayed.jpg", False, None)
    ]
    assert second["original"] is None
    shown = await store.http.get(f"/experiments/mine/runs/sampled/samples/{first['truth']}")
    assert shown.headers["content-type"] == "image/png"
    assert shown.headers["x-content-type-options"] == "nosniff"
    assert shown.content == sample_path(run, 3, TRUTH).read_bytes()


async def test_it_can_be_stopped_and_goes_on_from_there(store: Running, run: Path, renderer: FakeRenderer) -> None:
    sampled_run(store.results / "mine" / "runs" / "long", range(1, 40))
    begun, never = asyncio.Event(), asyncio.Event()
    answer = renderer.__call__

    async def stuck(request: httpx.Request) -> httpx.Response:
        if len(renderer.asked) >= 20:
            begun.set()
            await never.wait()
        return await answer(request)

    renderer.client = lambda: _client(stuck)  # type: ignore[method-assign]
    await store.http.post(ASK)
    await begun.wait()
    assert (await store.http.post(ASK)).json()["state"] == "running", "asking twice is asking once"
    assert (await store.http.delete("/experiments/mine")).status_code == 409, "it is not removed meanwhile"
    stopped = (await store.http.delete(ASK)).json()
    assert stopped["state"] == "idle"
    assert 0 < stopped["done"] < 41
    del renderer.client
    await store.http.post(ASK)
    assert (await ended(store))["done"] == 41
    assert (await store.http.delete("/experiments/mine")).status_code == 204


@asynccontextmanager
async def _client(answer: Any) -> AsyncIterator[RenderClient]:
    async with httpx.AsyncClient(base_url="http://render", transport=httpx.MockTransport(answer)) as http:
        yield patient_client(http)


async def test_a_store_that_ends_lets_go(tmp_path: Path, renderer: FakeRenderer) -> None:
    never = asyncio.Event()

    async def stuck(request: httpx.Request) -> httpx.Response:
        await never.wait()
        raise AssertionError

    renderer.client = lambda: _client(stuck)  # type: ignore[method-assign]
    async with running_store(tmp_path) as store:
        folder = by_command(store.results / "mine", 0)
        sampled_run(folder / "runs" / "sampled", [1])
        await store.http.post(ASK)
    del renderer.client
    async with running_store(tmp_path) as store:
        await store.http.post(ASK)
        assert (await ended(store))["done"] == 1


async def test_what_cannot_be_done_gets_a_sentence(store: Running, run: Path) -> None:
    await store.http.post(ASK)
    told = await ended(store)
    assert told["done"] == 0
    assert told["problem"].startswith(f"The render service at {NOBODY} does not answer")
    by_command(store.results / "old", 1)
    for path, status, type in (
        ("/experiments/none/materialise", 404, "unknown-experiment"),
        ("/experiments/old/materialise", 409, "no-samples"),
    ):
        answer = await store.http.post(path)
        assert (answer.status_code, answer.json()["type"]) == (status, f"tigas:{type}")


@pytest.mark.parametrize(
    "path",
    [
        "none/samples",
        "..%2Fother/samples",
        "sampled/samples/000003.png",
        "sampled/samples/000099.jpg",
        "sampled/samples/..%2F..%2Fsampled%2Frun.json",
        "sampled/samples/000003.replayed.jpg",
        "sampled/samples/%00",
    ],
)
async def test_nothing_but_pictures_of_samples_is_sent(store: Running, run: Path, path: str) -> None:
    assert (await store.http.get(f"/experiments/mine/runs/{path}")).status_code == 404


async def test_links_lead_nowhere(store: Running, run: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.jpg"
    mine.write_bytes(picture(1, 32, 18, "JPEG"))
    sample_path(run, 3, JPEG).unlink()
    sample_path(run, 3, JPEG).symlink_to(mine)
    path = "/experiments/mine/runs/sampled/samples"
    assert (await store.http.get(f"{path}/000003.jpg")).status_code == 404
    assert (await store.http.get(path)).json()["samples"][0]["original"] is None
    (run / "samples").rename(tmp_path / "samples")
    (run / "samples").symlink_to(tmp_path / "samples")
    write_sample_file(run, 12, JPEG, mine.read_bytes())
    assert (await store.http.get(f"{path}/000012.jpg")).status_code == 404
