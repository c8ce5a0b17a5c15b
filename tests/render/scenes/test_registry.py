"""The registry: scenes load once and on demand, and share a memory budget."""

from __future__ import annotations

import asyncio
import contextlib
import gc
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
from tigas_common.errors import BrokenScene, OutOfDeviceMemory, Overloaded, SceneInUse, UnknownScene
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource

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
    assert registry.scene_info("a").camera is None
    async with registry.use("a") as scene:
        assert scene.prepared.nbytes == 100
        assert scene.background == (0, 0, 0)
    async with registry.use("a") as again:
        assert again.prepared is scene.prepared
    assert bench.opened == ["a"]
    info = registry.scene_info("a")
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
    assert registry.scene_info("a").state == "loading"
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
    assert registry.scene_info("a").state == "loaded"
    registry.unload("a")  # a cancelled waiter does not hold the scene
    assert registry.scene_info("a").state == "unloaded"


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
    info = registry.scene_info("a")
    assert info.state == "broken"
    assert sentence in (info.error or "")
    with pytest.raises(BrokenScene):
        async with registry.use("a"):
            pass
    assert bench.opened == ["a"]
    await registry.load("b")  # nothing stays reserved
    del bench.errors["a"]
    await registry.load("a")
    assert registry.scene_info("a").state == "loaded"


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
    assert registry.scene_info("huge").state == "broken"
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
    registry.mark_viewed("a")
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
    assert registry.scene_info("slow").progress is None
    loading = asyncio.create_task(registry.load("slow"))
    await reading.half_way()
    assert (registry.scene_info("slow").state, registry.scene_info("slow").progress) == ("loading", 0.5)
    reading.go_on.set()
    await loading
    info = registry.scene_info("slow")
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
    assert registry.scene_info("slow").state == "unloaded"
    assert reading.closed.is_set(), "the open file is closed"


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
    assert registry.scene_info("slow").state == "loaded"


@pytest.mark.parametrize("scene_id", ["", "..", "../a", "a/../b", "/etc/passwd", "a\0", "A", "x" * 10_000, "\ud800"])
async def test_an_unknown_id_is_only_ever_looked_up(bench: Bench, tmp_path: Path, scene_id: str) -> None:
    write_ply(plys.write(tmp_path / "outside.ply", b""), plys.gaussians(2))
    registry = bench.registry(tmp_path)
    await registry.scan()
    for call in (registry.scene_info, registry.source, registry.unload):
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
    assert [registry.scene_info(id).state for id in ("older", "old", "new")] == ["unloaded", "loaded", "unloaded"]
    del bench.errors["new"]
    await registry.load("new")  # the device is tried again: its free memory varies
    assert registry.scene_info("new").state == "loaded"


async def test_what_did_not_fit_is_gone_before_it_is_tried_again() -> None:
    bench = Bench.of("old", "new")
    registry = bench.registry()
    await registry.load("old")
    half: list[weakref.ref[Packed]] = []

    def pack(scene: Batches) -> PreparedScene:
        packed = Packed(len(scene.read_all()))
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
    assert registry.scene_info("new").state == "loaded"


async def test_scenes_in_use_are_not_taken_for_a_full_device() -> None:
    bench = Bench.of("used", "new")
    registry = bench.registry()
    bench.errors["new"] = OutOfDeviceMemory("full")
    async with registry.use("used"):
        with pytest.raises(OutOfDeviceMemory):
            await registry.load("new")
        assert bench.opened == ["used", "new"]
    assert registry.scene_info("used").state == "loaded"
