"""Reports and archives over HTTP."""

from __future__ import annotations

import asyncio
import io
import tracemalloc
import zipfile
from pathlib import Path

import httpx
import pytest

from tests.experiments.made_up import write_run
from tests.experiments.store.conftest import Running, by_command
from tigas_experiments.store import reports
from tigas_experiments.store.experiments import list_runs
from tigas_experiments.store.reports import archive

pytestmark = pytest.mark.anyio


async def test_it_tells_of_the_experiments_runs(store: Running) -> None:
    experiment = await store.create("<script>alert(1)")
    nothing = await store.http.get(f"/experiments/{experiment}/report")
    assert (nothing.status_code, nothing.json()["type"]) == (409, "tigas:no-runs")
    await store.add(experiment)
    (outdated := store.results / experiment / "best.md").write_text("of other runs")
    answer = await store.http.get(f"/experiments/{experiment}/report")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "sandbox" in answer.headers["content-security-policy"]
    assert "courtyard" in answer.text
    assert "<script>alert" not in answer.text
    assert (store.results / experiment / "report.html").read_bytes() == answer.content
    assert (store.results / experiment / "runs.csv").is_file()
    assert not outdated.exists()


async def test_an_experiment_that_is_removed_while_its_report_is_drawn_stays_removed(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_command(store.results / "one", 1)

    def write(folder: Path, out: Path) -> None:
        folder.rename(store.results.parent / "removed")
        (out / "report.html").write_text("")

    monkeypatch.setattr(reports, "write_report_files", write)
    answer = await store.http.get("/experiments/one/report")
    assert (answer.status_code, answer.json()["type"]) == (404, "tigas:unknown-experiment")
    assert store.kept() == []


async def test_it_is_made_when_runs_come_or_go_and_not_otherwise(
    store: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def write(folder: Path, out: Path) -> None:
        made.append(len(list_runs(folder)))
        (out / "report.html").write_text(f"{made[-1]} runs")

    monkeypatch.setattr(reports, "write_report_files", write)
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
    (folder / "ladder.jpg").write_bytes(b"a picture of the ladder")
    assert (await store.http.get("/experiments/one/report")).text == "2 runs"
    assert made == [1, 2, 1, 2, 2]


async def test_it_holds_the_folder_as_it_is(store: Running) -> None:
    folder = by_command(store.results / "Größe 1", 2)
    (folder / "empty").mkdir()
    (folder / "secret").symlink_to("/etc/passwd")
    (folder / "runs" / "elsewhere").symlink_to("/etc")
    answer = await store.http.get("/experiments/Größe 1/zip")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/zip")
    assert answer.headers["content-disposition"] == "attachment; filename*=UTF-8''Gr%C3%B6%C3%9Fe%201.zip"
    with zipfile.ZipFile(io.BytesIO(answer.content)) as zipped:
        assert zipped.testzip() is None
        found = {name: zipped.read(name) for name in zipped.namelist()}
    wanted = {
        f"Größe 1/{path.relative_to(folder)}{'/' if path.is_dir() else ''}": b"" if path.is_dir() else path.read_bytes()
        for path in folder.rglob("*")
        if not path.is_symlink()
    }
    assert found == wanted | {"Größe 1/": b""}
    assert len(answer.content) < sum(map(len, wanted.values())) / 2, "nothing was compressed"


def test_it_takes_no_memory(tmp_path: Path) -> None:
    with (tmp_path / "long.ndjson").open("wb") as file:
        file.truncate(100_000_000)
    tracemalloc.start()
    try:
        size = sum(map(len, archive(tmp_path)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert size > 50_000
    assert peak < 3_000_000


def test_what_was_removed_before_is_no_archive(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        list(archive(tmp_path / "removed"))


async def test_a_download_breaks_off_when_its_experiment_is_removed(store: Running) -> None:
    folder = by_command(store.results / "big", 1)
    (folder / "a.png").write_bytes(bytes(30_000_000))  # more than the sockets hold; pictures are not compressed
    async with store.http.stream("GET", "/experiments/big/zip") as answer:
        await anext(parts := answer.aiter_raw())
        assert (await store.http.delete("/experiments/big")).status_code == 204
        with pytest.raises(httpx.RemoteProtocolError):
            _ = [part async for part in parts]
    assert store.kept() == []
    assert (await store.http.get("/healthz")).status_code == 200
