"""Files for download: made once, kept under a limit, and never half of one."""

from __future__ import annotations

import asyncio
import hashlib
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from tests.render.scenes import plys
from tigas_common.errors import BrokenScene, Overloaded
from tigas_common.wire.render import SavedView, SceneDownload
from tigas_render.downloads.cache import Check, DownloadCache, NoSpace, UnknownDownload
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource

pytestmark = pytest.mark.anyio

SOURCE = SceneSource("garden", SceneMetadata(), "1", lambda _: plys.gaussians(10).batches())
SIZE = 1000


@dataclass
class Maker:
    """Writes a file when the test lets it."""

    made: list[str] = field(default_factory=list)
    begun: threading.Event = field(default_factory=threading.Event)
    gate: threading.Event = field(default_factory=threading.Event)
    error: Exception | None = None

    def __post_init__(self) -> None:
        self.gate.set()

    def __call__(self, source: SceneSource, path: Path, check: Check) -> SceneDownload:
        self.made.append(source.id)
        self.begun.set()
        content = source.id.encode().ljust(SIZE)
        path.write_bytes(content)
        assert self.gate.wait(30)
        if self.error:
            raise self.error
        return SceneDownload(bytes=SIZE, sha256=hashlib.sha256(content).hexdigest(), gaussians=10)


def files(directory: Path) -> list[str]:
    return [path.name for path in directory.iterdir()]


async def test_a_file_is_made_once_and_known_from_then_on(tmp_path: Path) -> None:
    maker = Maker()
    cache = DownloadCache(tmp_path / "cache", 10 * SIZE, maker)
    assert {each.bytes for each in cache.available(SOURCE)} == {None}
    made = await cache.get(SOURCE)
    assert made.path.read_bytes().strip() == b"garden"
    assert await cache.get(SOURCE) == made
    later = DownloadCache(tmp_path / "cache", 10 * SIZE, maker)  # after a restart
    assert await later.get(SOURCE) == made
    assert made.metadata in later.available(SOURCE)
    assert maker.made == ["garden"]
    assert len(files(tmp_path / "cache")) == 2  # with its metadata


async def test_concurrent_first_requests_make_it_once_and_may_give_up(tmp_path: Path) -> None:
    maker = Maker()
    maker.gate.clear()
    cache = DownloadCache(tmp_path, 10 * SIZE, maker)
    first, second = (asyncio.create_task(cache.get(SOURCE)) for _ in range(2))
    assert await asyncio.to_thread(maker.begun.wait, 30)
    first.cancel()
    maker.gate.set()
    assert (await second).metadata.bytes == SIZE
    assert maker.made == ["garden"]


@pytest.mark.parametrize("is_read", [False, True])
async def test_one_that_is_being_made_ends_early_when_the_service_stops(tmp_path: Path, is_read: bool) -> None:
    cache = DownloadCache(tmp_path, 10**6)

    def open(listener: Listener) -> Batches:
        return Batches(20, parts(listener))

    def parts(listener: Listener) -> Iterator[Gaussians]:
        yield plys.gaussians(10)
        cache.close()
        while not is_read:
            listener(0.5)

    with pytest.raises(Overloaded, match="the service is stopping"):
        await cache.get(replace(SOURCE, open=open))
    assert files(tmp_path) == []


async def test_another_version_or_camera_is_another_file_but_a_saved_view_is_not(tmp_path: Path) -> None:
    cache = DownloadCache(tmp_path, 10 * SIZE, Maker())
    turned = SceneMetadata(up=(0, 1, 0))
    saved = SceneMetadata(views={"Door": SavedView(position=(0, 0, 0), quaternion=(0, 0, 0, 1))})
    described = [replace(SOURCE, metadata=metadata) for metadata in (turned, saved)]
    sources = (SOURCE, replace(SOURCE, version="2"), *described)
    assert len({(await cache.get(source)).path for source in sources}) == 3


async def test_the_longest_unused_file_makes_room_for_a_new_one(tmp_path: Path) -> None:
    cache = DownloadCache(tmp_path, 2 * SIZE, Maker())
    a, b, c = (replace(SOURCE, id=id) for id in "abc")
    for age, source in enumerate((b, a)):
        os.utime((await cache.get(source)).path, (age, age))
    await cache.get(b)  # used again: now the other is the longest unused
    await cache.get(c)
    known = {source.id: cache.available(source)[0].bytes for source in (a, b, c)}
    assert known == {"a": None, "b": SIZE, "c": SIZE}
    assert len(files(tmp_path)) == 4


async def test_another_process_goes_on_making_its_file(tmp_path: Path) -> None:
    being_made = tmp_path / "other.compressed.1.tmp"
    being_made.write_bytes(bytes(SIZE))
    os.utime(being_made, (1, time.time()))
    await DownloadCache(tmp_path, SIZE, Maker()).get(SOURCE)
    assert being_made.exists()


async def test_a_file_over_the_limit_is_refused_and_leaves_the_others(tmp_path: Path) -> None:
    await DownloadCache(tmp_path, SIZE, Maker()).get(SOURCE)
    with pytest.raises(NoSpace, match=r"^b takes 0\.0 MB as a download, and all together may take 0\.0 MB\.$"):
        await DownloadCache(tmp_path, SIZE - 1, Maker()).get(replace(SOURCE, id="b"))
    assert len(files(tmp_path)) == 2


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), BrokenScene("It changed.")])
async def test_what_could_not_be_made_leaves_nothing_and_is_tried_again(tmp_path: Path, error: Exception) -> None:
    maker = Maker(error=error)
    cache = DownloadCache(tmp_path, 10 * SIZE, maker)
    with pytest.raises(NoSpace if isinstance(error, OSError) else BrokenScene):
        await cache.get(SOURCE)
    assert not files(tmp_path)
    maker.error = None
    assert (await cache.get(SOURCE)).metadata.bytes == SIZE


async def test_a_file_that_was_cut_off_is_made_again(tmp_path: Path) -> None:
    maker = Maker()
    cache = DownloadCache(tmp_path, 10 * SIZE, maker)
    os.truncate((await cache.get(SOURCE)).path, 5)
    assert cache.available(SOURCE)[0].bytes is None
    assert len((await cache.get(SOURCE)).path.read_bytes()) == SIZE
    assert maker.made == ["garden", "garden"]


async def test_a_cache_that_cannot_be_written_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NoSpace, match="cannot store garden as a download: "):
        await DownloadCache(tmp_path / "file" / "cache", SIZE, Maker()).get(SOURCE)


async def test_what_is_not_offered(tmp_path: Path) -> None:
    broken = replace(SOURCE, open=None, error="It has no vertices.")
    cache = DownloadCache(tmp_path, SIZE, Maker())
    assert cache.available(broken) == ()
    with pytest.raises(BrokenScene, match="no vertices"):
        await cache.get(broken)
    without = DownloadCache(tmp_path, 0, Maker())
    assert without.available(SOURCE) == ()
    with pytest.raises(UnknownDownload, match=r"^garden is not offered for download\.$"):
        await without.get(SOURCE)
