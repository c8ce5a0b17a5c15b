"""The registry: scenes load once and on demand, share a memory budget, and follow the models directory."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import hashlib
import os
import shutil
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from reference.ply import write_ply
from tests.fuzz.fuzzers import assert_sentence
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench, Packed, states
from tests.render.scenes.start_view.captures import statue, turned
from tigas_common.errors import BrokenScene, OutOfDeviceMemory, Overloaded, SceneInUse, UnknownScene
from tigas_common.wire.render import StartCamera
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes import directory as directory_module
from tigas_render.scenes import registry as registry_module
from tigas_render.scenes.directory import scan_directory
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource
from tigas_render.scenes.start_view.view import KeptViews

pytestmark = pytest.mark.anyio


@pytest.fixture
def bench() -> Bench:
    """Three scenes that are loaded without files."""
    return Bench.of("a", "b", "c")


async def until_opened(bench: Bench, count: int = 1) -> None:
    for _ in range(count):
        assert await asyncio.to_thread(bench.started.acquire, timeout=10)


async def given_up(task: asyncio.Task[Any]) -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


async def test_the_first_use_loads_and_later_ones_do_not(bench: Bench) -> None:
    registry = bench.registry()
    assert states(registry) == {"a": "unloaded", "b": "unloaded", "c": "unloaded"}
    assert registry.info("a").camera is None
    async with registry.use("a") as scene:
        assert scene.prepared.nbytes == 100
        assert scene.background == (0, 0, 0)
    async with registry.use("a") as again:
        assert again.prepared is scene.prepared
    assert bench.opened == ["a"]
    info = registry.info("a")
    assert (info.state, info.gaussians, info.memory_bytes) == ("loaded", 100, 100)
    assert info.camera == scene.camera


async def test_a_loaded_scene_is_entered_without_giving_up_the_event_loop(bench: Bench) -> None:
    registry = bench.registry()
    await registry.load("a")
    others: list[str] = []
    asyncio.get_running_loop().call_soon(others.append, "ran")
    async with registry.use("a"):
        assert others == []


async def test_concurrent_first_uses_load_once_and_leave_the_event_loop_free(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()

    async def use() -> PreparedScene:
        async with registry.use("a") as scene:
            return scene.prepared

    users = [asyncio.create_task(use()) for _ in range(5)]
    await until_opened(bench)
    assert registry.info("a").state == "loading"
    async with registry.use("b"):  # others are served meanwhile
        pass
    bench.gates["a"].set()
    assert len(set(map(id, await asyncio.gather(*users)))) == 1
    assert bench.opened == ["a", "b"]


async def test_many_scenes_that_load_leave_worker_threads_for_others() -> None:
    ids = [f"scene-{number}" for number in range(40)]  # more than there are threads
    bench = Bench.of(*ids)
    bench.budget, bench.gates = 10_000, dict.fromkeys(ids, threading.Event())
    registry = bench.registry()
    loading = [asyncio.create_task(registry.load(id)) for id in ids]
    await until_opened(bench, 2)
    async with asyncio.timeout(5):
        assert await asyncio.to_thread(lambda: "free") == "free"
    assert len(bench.opened) == 2
    bench.gates[ids[0]].set()
    await asyncio.gather(*loading)
    assert set(states(registry).values()) == {"loaded"}


async def test_a_scene_that_waits_for_its_turn_is_unloaded_without_waiting_for_others() -> None:
    names = ["a", "b", "c"]
    bench = Bench.of(*names)
    bench.budget, bench.gates = 10_000, dict.fromkeys(names, threading.Event())
    registry = bench.registry()
    loads = [asyncio.create_task(registry.load(name)) for name in names]
    await until_opened(bench, 2)
    await given_up(loads[2])
    assert sorted(registry.memory()) == names
    registry.unload("c")
    assert sorted(registry.memory()) == ["a", "b"]
    again = asyncio.create_task(registry.load("c"))
    bench.gates["a"].set()
    await asyncio.gather(*loads[:2], again)
    assert sorted(registry.memory()) == names


async def test_one_who_gives_up_waiting_does_not_take_the_scene_from_the_others(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()
    first, second = (asyncio.create_task(registry.load("a")) for _ in range(2))
    await until_opened(bench)
    await given_up(first)
    bench.gates["a"].set()
    await second
    assert bench.opened == ["a"]
    assert registry.info("a").state == "loaded"
    registry.unload("a")  # a cancelled waiter does not hold the scene
    assert registry.info("a").state == "unloaded"


@pytest.mark.parametrize(
    ("error", "sentence"), [(BrokenScene("It is torn."), "It is torn."), (RuntimeError("secret"), "the server's log")]
)
async def test_a_failed_load_reaches_everybody_and_is_not_repeated_until_asked(
    bench: Bench, error: Exception, sentence: str
) -> None:
    bench.budget, bench.gates["a"], bench.errors["a"] = 150, threading.Event(), error
    registry = bench.registry()
    tasks = [asyncio.create_task(registry.load("a")) for _ in range(3)]
    await until_opened(bench)
    bench.gates["a"].set()
    for outcome in await asyncio.gather(*tasks, return_exceptions=True):
        assert isinstance(outcome, BrokenScene)
        assert sentence in outcome.detail
    info = registry.info("a")
    assert info.state == "broken"
    assert sentence in (info.error or "")
    with pytest.raises(BrokenScene):
        async with registry.use("a"):
            pass
    assert bench.opened == ["a"]
    await registry.load("b")  # nothing stays reserved
    del bench.errors["a"]
    await registry.load("a")
    assert registry.info("a").state == "loaded"


async def test_idle_scenes_are_evicted_unless_they_are_used(bench: Bench) -> None:
    registry = bench.registry()
    await registry.load("a")
    await registry.load("b")
    async with registry.use("b"):
        bench.now = 59
        registry.evict_idle(bench.now)
        assert states(registry)["a"] == "loaded"
        bench.now = 60
        registry.evict_idle(bench.now)
        assert states(registry) == {"a": "unloaded", "b": "loaded", "c": "unloaded"}
    registry.evict_idle(bench.now)  # released just now
    assert states(registry)["b"] == "loaded"
    registry.evict_idle(bench.now + 60)
    assert states(registry)["b"] == "unloaded"


async def test_the_least_recently_used_scenes_make_room(bench: Bench) -> None:
    bench.budget, bench.gates["c"] = 250, threading.Event()
    registry = bench.registry()
    for bench.now, id in enumerate(("a", "b", "a")):
        await registry.load(id)
    loading = asyncio.create_task(registry.load("c"))
    await until_opened(bench, 3)
    assert states(registry) == {"a": "loaded", "b": "unloaded", "c": "loading"}, "room is made before loading"
    bench.gates["c"].set()
    await loading
    assert states(registry) == {"a": "loaded", "b": "unloaded", "c": "loaded"}


async def test_scenes_in_use_stay_and_the_newcomer_is_told(bench: Bench) -> None:
    bench.budget = 150
    registry = bench.registry()
    async with registry.use("a"):
        with pytest.raises(Overloaded, match="no room for b"):
            await registry.load("b")
        assert states(registry) == {"a": "loaded", "b": "unloaded", "c": "unloaded"}
    await registry.load("b")
    assert states(registry) == {"a": "unloaded", "b": "loaded", "c": "unloaded"}


@pytest.mark.parametrize("estimate", [2000, 10])
async def test_a_scene_beyond_the_budget_is_broken_and_disturbs_nobody(bench: Bench, estimate: int) -> None:
    bench.add("huge", count=2000, estimate=estimate)
    registry = bench.registry()
    await registry.load("a")
    with pytest.raises(
        BrokenScene, match=r"^huge takes 0\.0 MB in memory, and all scenes together may take 0\.0 MB\.$"
    ):
        await registry.load("huge")
    assert states(registry)["a"] == "loaded"
    assert registry.info("huge").state == "broken"
    assert bench.opened == (["a"] if estimate > 1000 else ["a", "huge"])
    await registry.load("b")  # nothing stays reserved


async def test_nobody_unloads_what_another_views_or_waits_for(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()
    waiting = asyncio.create_task(registry.load("a"))
    await until_opened(bench)
    with pytest.raises(SceneInUse):
        registry.unload("a")
    bench.gates["a"].set()
    await waiting
    async with registry.use("a"):
        with pytest.raises(SceneInUse, match=r"less than 30 seconds ago"):
            registry.unload("a")
    registry.viewed("a")
    bench.now += 29  # the viewer stands still
    with pytest.raises(SceneInUse):
        registry.unload("a")
    assert states(registry)["a"] == "loaded"
    bench.now += 30
    for _ in range(2):
        registry.unload("a")
        assert states(registry)["a"] == "unloaded"
    await registry.load("a")
    registry.unload("a")  # loading does not count as viewing
    assert states(registry)["a"] == "unloaded"
    assert bench.opened == ["a", "a"]


@dataclass
class Slow:
    """Reads a scene in two parts, and waits between them until it may go on."""

    half: threading.Event = field(default_factory=threading.Event)
    go_on: threading.Event = field(default_factory=threading.Event)
    closed: threading.Event = field(default_factory=threading.Event)

    def open(self, listener: Listener) -> Batches:
        return Batches(200, self._parts(listener))

    def _parts(self, listener: Listener) -> Iterator[Gaussians]:
        try:
            yield plys.gaussians(100)
            listener(0.5)
            self.half.set()
            assert self.go_on.wait(10)
            listener(0.75)
            yield plys.gaussians(100)
            listener(1)
        finally:
            self.closed.set()

    async def half_way(self) -> None:
        assert await asyncio.to_thread(self.half.wait, 10)


def slow(bench: Bench) -> Slow:
    """A scene `slow`."""
    reading = Slow()
    bench.builtin["slow"] = SceneSource("slow", SceneMetadata(), "1", reading.open, sh_degree=0, memory_bytes=200)
    return reading


async def test_how_much_of_a_loading_scene_was_read_is_told(bench: Bench) -> None:
    reading, registry = slow(bench), bench.registry()
    assert registry.info("slow").progress is None
    loading = asyncio.create_task(registry.load("slow"))
    await reading.half_way()
    assert (registry.info("slow").state, registry.info("slow").progress) == ("loading", 0.5)
    reading.go_on.set()
    await loading
    info = registry.info("slow")
    assert (info.state, info.progress, info.gaussians) == ("loaded", None, 200)


@pytest.mark.parametrize("end", [lambda registry: registry.unload("slow"), SceneRegistry.close])
async def test_a_load_that_nobody_waits_for_can_be_ended(bench: Bench, end: Callable[[SceneRegistry], None]) -> None:
    reading, registry = slow(bench), bench.registry()
    waiting = asyncio.create_task(registry.use("slow").enter())
    await reading.half_way()
    await given_up(waiting)
    end(registry)
    reading.go_on.set()
    await asyncio.gather(*(task for task in asyncio.all_tasks() if task.get_name() == "load slow"))
    assert registry.info("slow").state == "unloaded"
    assert reading.closed.is_set(), "what was open is closed"


async def test_one_who_comes_before_an_unloaded_scene_has_stopped_loading_gets_it(bench: Bench) -> None:
    reading, registry = slow(bench), bench.registry()
    waiting = asyncio.create_task(registry.load("slow"))
    await reading.half_way()
    await given_up(waiting)
    registry.unload("slow")
    late = asyncio.create_task(registry.load("slow"))
    await asyncio.sleep(0)
    reading.go_on.set()
    await late
    assert registry.info("slow").state == "loaded"


@pytest.mark.parametrize("scene_id", ["", "..", "../a", "a/../b", "/etc/passwd", "a\0", "A", "x" * 10_000, "\ud800"])
async def test_an_unknown_id_is_only_ever_looked_up(bench: Bench, tmp_path: Path, scene_id: str) -> None:
    write_ply(plys.write(tmp_path / "outside.ply", b""), plys.gaussians(2))
    registry = bench.registry(tmp_path)
    await registry.scan()
    for call in (registry.info, registry.source, registry.unload):
        with pytest.raises(UnknownScene):
            call(scene_id)
    with pytest.raises(UnknownScene) as failure:
        await registry.load(scene_id)
    assert_sentence(failure.value.detail)


async def test_stopping_ends_a_load_that_somebody_waits_for(bench: Bench) -> None:
    reading, registry = slow(bench), bench.registry()
    waiting = asyncio.create_task(registry.load("slow"))
    await reading.half_way()
    registry.close()
    reading.go_on.set()
    with pytest.raises(Overloaded, match="the service is stopping"):
        await waiting
    with pytest.raises(Overloaded, match="the service is stopping"):
        await registry.load("a")
    assert reading.closed.is_set()


async def test_a_file_that_is_renamed_while_it_loads_is_a_sentence_without_a_traceback(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench.of("a")
    bench.builtin["a"] = replace(bench.builtin["a"], digest=lambda: (tmp_path / "renamed.ply").read_text())
    with pytest.raises(BrokenScene, match=r"^a cannot be read: No such file or directory\.$"):
        await bench.registry().load("a")
    assert "Traceback" not in caplog.text


def make_scene(folder: Path, count: int = 5, **metadata: Any) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "scene.ply", plys.gaussians(count))
    if metadata:
        (folder / "scene.json").write_text(SceneMetadata(**metadata).model_dump_json())
    return folder


async def test_a_directory_of_scenes(tmp_path: Path) -> None:
    make_scene(tmp_path / "garden", name="The garden", background=(0.1, 0.2, 0.3))
    make_scene(tmp_path / "Küche 2")
    plys.write(tmp_path / "torn" / "scene.ply", plys.binary_ply()[:-1])
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    assert states(registry) == {"Küche 2": "unloaded", "garden": "unloaded", "torn": "broken"}
    garden = registry.info("garden")
    assert (garden.name, garden.gaussians, garden.sh_degree) == ("The garden", 5, 0)
    assert garden.background == (0.1, 0.2, 0.3)
    assert garden.file_bytes == (tmp_path / "garden" / "scene.ply").stat().st_size
    assert registry.info("Küche 2").preview == "/scenes/K%C3%BCche%202/preview"
    assert "truncated" in (registry.info("torn").error or "")
    async with registry.use("garden") as scene:
        assert scene.background == (0.1, 0.2, 0.3)
    with pytest.raises(BrokenScene, match="truncated"):
        await registry.load("torn")


async def test_a_rescan_follows_the_directory_and_keeps_what_is_loaded(tmp_path: Path) -> None:
    for name in ("stays", "goes", "changes"):
        make_scene(tmp_path / name)
    plys.write(tmp_path / "torn" / "scene.ply", b"")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    for name in ("stays", "goes", "changes"):
        await registry.load(name)
    async with registry.use("stays") as scene:
        before = scene.prepared
    shutil.rmtree(tmp_path / "goes")
    make_scene(tmp_path / "changes", count=7)
    make_scene(tmp_path / "torn")
    make_scene(tmp_path / "stays" / "ignored")
    (tmp_path / "stays" / "scene.json").write_text(
        '{"name": "Renamed", "camera": {"position": [1,2,3], "look_at": [0,0,0]}}'
    )
    await registry.scan()
    assert states(registry) == {"changes": "unloaded", "stays": "loaded", "torn": "unloaded"}
    assert registry.info("changes").gaussians == 7
    assert registry.info("stays").name == "Renamed"
    async with registry.use("stays") as scene:
        assert scene.prepared is before
        assert scene.camera == StartCamera(position=(1, 2, 3), look_at=(0, 0, 0))


async def test_a_derived_view_is_known_after_a_restart_without_loading(tmp_path: Path) -> None:
    folder = make_scene(tmp_path / "models" / "lying")
    scene, up = turned(statue(), (1, 0, 0), -90)
    write_ply(folder / "scene.ply", scene)
    files = sorted(folder.iterdir())
    views = KeptViews(tmp_path / "cache")
    registry = Bench(budget=10**8).registry(tmp_path / "models", views=views)
    await registry.scan()
    before = registry.info("lying")
    assert (before.up, before.camera) == ((0, -1, 0), None)
    await registry.load("lying")
    info = registry.info("lying")
    assert info.up == pytest.approx(up, abs=0.05)
    assert info.camera is not None
    registry.unload("lying")
    restarted = Bench(budget=10**6).registry(tmp_path / "models", views=views)
    await restarted.scan()
    known = restarted.info("lying")
    assert (known.state, known.up, known.camera) == ("unloaded", info.up, info.camera)
    assert sorted(folder.iterdir()) == files, "the scene's folder is the user's"


async def test_scene_json_takes_the_place_of_a_derived_view(tmp_path: Path) -> None:
    folder = make_scene(tmp_path / "models" / "garden")
    registry = Bench(budget=10**6).registry(tmp_path / "models", views=KeptViews(tmp_path / "cache"))
    await registry.scan()
    await registry.load("garden")
    derived = registry.info("garden").camera
    (folder / "scene.json").write_text('{"up": [0, 0, 1]}')
    await registry.scan()
    assert registry.info("garden").up == (0, 0, 1)
    (folder / "scene.json").write_text('{"camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}')
    await registry.scan()
    info = registry.info("garden")
    assert (info.up, info.camera) == ((0, -1, 0), StartCamera(position=(1, 2, 3), look_at=(0, 0, 0)))
    (folder / "scene.json").unlink()
    await registry.scan()
    assert registry.info("garden").camera == derived


async def test_metadata_that_is_edited_while_a_scene_loads_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_scene(tmp_path / "garden")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    loading, edited = threading.Event(), threading.Event()

    def digest(_: object) -> str:
        loading.set()
        assert edited.wait(10)
        return "00" * 32

    monkeypatch.setattr(directory_module, "_sha256", digest)
    loaded = asyncio.create_task(registry.load("garden"))
    assert await asyncio.to_thread(loading.wait, 10)
    (folder / "scene.json").write_text('{"camera": {"position": [1, 2, 3], "look_at": [0, 0, 0]}}')
    await registry.scan()
    edited.set()
    await loaded
    assert registry.info("garden").camera == StartCamera(position=(1, 2, 3), look_at=(0, 0, 0))
    async with registry.use("garden") as scene:
        assert scene.camera == registry.info("garden").camera


async def test_scenes_stay_while_their_directory_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    make_scene(tmp_path / "garden")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    await registry.load("garden")

    def broken(_: Path) -> Iterator[Path]:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "iterdir", broken)
        await registry.scan()
    assert "Too many open files" in caplog.text
    assert states(registry) == {"garden": "loaded"}
    async with registry.use("garden"):
        pass


async def test_a_scene_has_the_digest_of_the_file_that_was_loaded(tmp_path: Path) -> None:
    file = make_scene(tmp_path / "garden") / "scene.ply"
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    assert registry.info("garden").file_sha256 is None, "nobody reads gigabytes to list scenes"
    await registry.load("garden")
    first = hashlib.sha256(file.read_bytes()).hexdigest()
    assert registry.info("garden").file_sha256 == first
    registry.unload("garden")
    assert registry.info("garden").file_sha256 == first
    changed = bytearray(file.read_bytes())
    changed[-1] ^= 1  # of the same size
    file.write_bytes(changed)
    os.utime(file, ns=(1, 1))
    for rescanned in (False, True):
        if rescanned:
            await registry.scan()
        await registry.load("garden")
        assert registry.info("garden").file_sha256 == hashlib.sha256(changed).hexdigest()


async def test_a_scene_that_vanishes_stays_with_whoever_uses_it_and_counts_until_then(tmp_path: Path) -> None:
    make_scene(tmp_path / "goes", count=80)
    bench = Bench(budget=5000)
    bench.add("other", count=4950)
    registry = bench.registry(tmp_path)
    await registry.scan()
    async with registry.use("goes") as scene:
        shutil.rmtree(tmp_path / "goes")
        await registry.scan()
        assert scene.prepared.nbytes == 80
        with pytest.raises(UnknownScene):
            registry.info("goes")
        with pytest.raises(Overloaded):
            await registry.load("other")
    await registry.load("other")


async def test_loading_a_broken_scene_looks_at_its_file_again(tmp_path: Path) -> None:
    plys.write(tmp_path / "torn" / "scene.ply", b"")
    registry = Bench(budget=10**6).registry(tmp_path)
    await registry.scan()
    with pytest.raises(BrokenScene, match="empty"):
        await registry.load("torn")
    make_scene(tmp_path / "torn")
    await registry.load("torn")
    assert registry.info("torn").state == "loaded"


class SlowDisk:
    """Lists a directory at once, and answers when it is let."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.listed = threading.Semaphore(0)
        self.answers = threading.Semaphore(0)
        self.listings = 0
        monkeypatch.setattr(registry_module, "scan_directory", self.scan)

    def scan(self, directory: Path) -> dict[str, SceneSource]:
        found = scan_directory(directory)
        self.listings += 1
        self.listed.release()
        assert self.answers.acquire(timeout=10)
        return found


async def test_a_listing_from_before_a_change_undoes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    make_scene(tmp_path / "removed")
    scenes = Bench(budget=10**6).registry(tmp_path)
    early = asyncio.create_task(scenes.scan())
    assert await asyncio.to_thread(disk.listed.acquire, timeout=10)
    make_scene(tmp_path / "new")
    shutil.rmtree(tmp_path / "removed")
    late = [asyncio.create_task(scenes.scan()) for _ in range(3)]
    disk.answers.release(10)
    await asyncio.gather(early, *late)
    assert states(scenes) == {"new": "unloaded"}
    assert disk.listings == 2, "those that waited shared one"


async def test_a_scan_that_is_given_up_holds_up_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    scenes = Bench(budget=10**6).registry(tmp_path)
    early = asyncio.create_task(scenes.scan())
    assert await asyncio.to_thread(disk.listed.acquire, timeout=10)
    make_scene(tmp_path / "new")
    late = asyncio.create_task(scenes.scan())
    early.cancel()
    disk.answers.release(10)
    await late
    assert states(scenes) == {"new": "unloaded"}


async def test_a_folder_takes_the_place_of_a_built_in_scene(bench: Bench, tmp_path: Path) -> None:
    make_scene(tmp_path / "a", count=3)
    registry = bench.registry(tmp_path)
    assert registry.info("a").gaussians is None
    await registry.scan()
    assert registry.info("a").gaussians == 3
    assert set(states(registry)) == {"a", "b", "c"}


async def test_a_device_that_is_full_gets_room_once() -> None:
    bench = Bench.of("old", "older", "new")
    registry = bench.registry()
    await registry.load("older")
    bench.now += 1
    await registry.load("old")
    bench.errors["new"] = OutOfDeviceMemory("full")
    with pytest.raises(OutOfDeviceMemory):
        await registry.load("new")
    assert bench.opened == ["older", "old", "new", "new"]
    assert [registry.info(id).state for id in ("older", "old", "new")] == ["unloaded", "loaded", "unloaded"]
    del bench.errors["new"]
    await registry.load("new")  # the device is tried again: its free memory varies
    assert registry.info("new").state == "loaded"


async def test_what_did_not_fit_is_gone_before_it_is_tried_again() -> None:
    bench = Bench.of("old", "new")
    registry = bench.registry()
    await registry.load("old")
    half: list[weakref.ref[Packed]] = []

    def pack(scene: Batches) -> PreparedScene:
        packed = Packed(len(scene.gathered()))
        if not half:
            half.append(weakref.ref(packed))
            raise OutOfDeviceMemory("full")
        assert half[0]() is None, "the first attempt still holds its memory"
        return packed

    registry._pack = pack
    gc.disable()  # the first attempt's memory is to be free without the garbage collector
    try:
        await registry.load("new")
    finally:
        gc.enable()
    assert registry.info("new").state == "loaded"


async def test_scenes_in_use_are_not_taken_for_a_full_device() -> None:
    bench = Bench.of("used", "new")
    registry = bench.registry()
    bench.errors["new"] = OutOfDeviceMemory("full")
    async with registry.use("used"):
        with pytest.raises(OutOfDeviceMemory):
            await registry.load("new")
        assert bench.opened == ["used", "new"]
    assert registry.info("used").state == "loaded"
