"""An experiment's report on demand."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.experiments.made_up import write_run
from tests.experiments.store.conftest import Running, by_command
from tigas_experiments.store import reports
from tigas_experiments.store.experiments import made_runs

pytestmark = pytest.mark.anyio


async def test_it_tells_of_the_experiments_runs(store: Running) -> None:
    experiment = await store.create("<script>alert(1)")
    nothing = await store.http.get(f"/experiments/{experiment}/report")
    assert (nothing.status_code, nothing.json()["type"]) == (409, "tigas:no-runs")
    await store.add(experiment)
    answer = await store.http.get(f"/experiments/{experiment}/report")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "sandbox" in answer.headers["content-security-policy"]
    assert "courtyard" in answer.text
    assert "<script>alert" not in answer.text
    assert (store.results / experiment / "report.html").read_bytes() == answer.content
    assert (store.results / experiment / "runs.csv").is_file()


async def test_an_experiment_that_is_removed_while_its_report_is_drawn_stays_removed(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_command(store.results / "one", 1)

    def write(folder: Path, out: Path) -> None:
        folder.rename(store.results.parent / "removed")
        (out / "report.html").write_text("")

    monkeypatch.setattr(reports, "draw", write)
    answer = await store.http.get("/experiments/one/report")
    assert (answer.status_code, answer.json()["type"]) == (404, "tigas:unknown-experiment")
    assert store.kept() == []


async def test_it_is_made_when_runs_come_or_go_and_not_otherwise(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def write(folder: Path, out: Path) -> None:
        made.append(len(made_runs(folder)))
        (out / "report.html").write_text(f"{made[-1]} runs")

    monkeypatch.setattr(reports, "draw", write)
    folder = by_command(store.results / "one", 1)
    answers = await asyncio.gather(*(store.http.get("/experiments/one/report") for _ in range(5)))
    assert ({answer.text for answer in answers}, made) == ({"1 runs"}, [1])
    write_run(folder / "runs" / "01", repeat=1)
    assert (await store.http.get("/experiments/one/report")).text == "2 runs"
    (folder / "runs" / "00").rename(folder / "moved")
    assert (await store.http.get("/experiments/one/report")).text == "1 runs"
    write_run(folder / "runs" / "00")
    (folder / "report.html").unlink()
    assert (await store.http.get("/experiments/one/report")).text == "2 runs"
    assert (await store.http.get("/experiments/one/report")).text == "2 runs"
    assert made == [1, 2, 1, 2]
