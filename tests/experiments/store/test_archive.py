"""An experiment as a ZIP."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from pathlib import Path

import httpx
import pytest

from tests.experiments.store.conftest import Running, by_command
from tigas_experiments.store.archive import archive

pytestmark = pytest.mark.anyio


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
