"""The registry: scenes load once and on demand, share a memory budget, and come and go with the models directory."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from reference.ply import write_ply
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench, states
from tigas_common.errors import BrokenScene, Overloaded, SceneInUse, TigasError, UnknownScene
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource

pytestmark = pytest.mark.anyio


async def until_opened(bench: Bench, count: int = 1) -> None:
    for _ in range(count):
        assert await asyncio.to_thread(bench.started.acquire, timeout=10)


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
    use = registry.use("a")
    with pytest.raises(StopIteration):  # the coroutine ends at once: nothing was awaited
        use.__aenter__().send(None)
    await use.__aexit__(None, None, None)


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


async def test_one_who_gives_up_waiting_does_not_take_the_scene_from_the_others(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()
    first, second = (asyncio.create_task(registry.load("a")) for _ in range(2))
    await until_opened(bench)
    first.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await first
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
    bench.gates["a"], bench.errors["a"] = threading.Event(), error
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
    del bench.errors["a"]
    await registry.load("a")
    assert registry.info("a").state == "loaded"


async def test_a_failed_load_gives_its_room_back(bench: Bench) -> None:
    bench.budget, bench.errors["a"] = 150, BrokenScene("It is torn.")
    registry = bench.registry()
    with pytest.raises(BrokenScene):
        await registry.load("a")
    await registry.load("b")


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
    bench.budget = 250
    registry = bench.registry()
    for bench.now, id in enumerate(("a", "b", "a", "c")):
        await registry.load(id)
    assert states(registry) == {"a": "loaded", "b": "unloaded", "c": "loaded"}


async def test_room_is_made_before_loading(bench: Bench) -> None:
    bench.budget, bench.gates["b"] = 150, threading.Event()
    registry = bench.registry()
    await registry.load("a")
    loading = asyncio.create_task(registry.load("b"))
    await until_opened(bench, 2)
    assert states(registry) == {"a": "unloaded", "b": "loading", "c": "unloaded"}
    bench.gates["b"].set()
    await loading


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
    with pytest.raises(BrokenScene, match=r"huge takes 0\.0 MB in memory, and all scenes together may take 0\.0 MB"):
        await registry.load("huge")
    assert states(registry)["a"] == "loaded"
    assert registry.info("huge").state == "broken"
    assert bench.opened == (["a"] if estimate > 1000 else ["a", "huge"])
    await registry.load("b")  # nothing stays reserved


async def test_nobody_unloads_what_another_views(bench: Bench) -> None:
    registry = bench.registry()
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


async def test_nobody_unloads_what_another_waits_for(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()
    waiting = asyncio.create_task(registry.load("a"))
    await until_opened(bench)
    with pytest.raises(SceneInUse):
        registry.unload("a")
    bench.gates["a"].set()
    await waiting
    assert states(registry)["a"] == "loaded"


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


async def test_unloading_ends_a_load_that_nobody_waits_for(bench: Bench) -> None:
    reading, registry = slow(bench), bench.registry()
    waiting = asyncio.create_task(registry.load("slow"))
    await reading.half_way()
    waiting.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await waiting
    registry.unload("slow")
    late = asyncio.create_task(registry.load("slow"))  # comes before the reader has noticed
    await asyncio.sleep(0)
    reading.go_on.set()
    await late
    assert registry.info("slow").state == "loaded"
    registry.unload("slow")

    again = slow(bench)
    registry = bench.registry()
    loading = asyncio.create_task(registry.use("slow").enter())
    await again.half_way()
    loading.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await loading
    registry.close()
    again.go_on.set()
    await asyncio.gather(*(task for task in asyncio.all_tasks() if task.get_name() == "load slow"))
    assert registry.info("slow").state == "unloaded"
    assert again.closed.is_set(), "what was open is closed"


async def test_unload_while_loading_unloads_afterwards(bench: Bench) -> None:
    bench.gates["a"] = threading.Event()
    registry = bench.registry()
    uses = asyncio.create_task(registry.use("a").__aenter__())
    await until_opened(bench)
    uses.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await uses
    registry.unload("a")
    bench.gates["a"].set()
    await asyncio.gather(*(task for task in asyncio.all_tasks() if task.get_name() == "load a"))
    assert registry.info("a").state == "unloaded"


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
    assert len(failure.value.detail) < 500


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
    reading = Slow()
    bench = Bench()
    bench.builtin["slow"] = SceneSource(
        "slow",
        SceneMetadata(),
        "1",
        reading.open,
        digest=lambda: (tmp_path / "renamed.ply").read_text(),
        sh_degree=0,
        memory_bytes=200,
    )
    reading.go_on.set()
    with pytest.raises(BrokenScene, match=r"^slow cannot be read: No such file or directory\.$"):
        await bench.registry().load("slow")
    assert "Traceback" not in caplog.text


async def test_every_refusal_is_a_sentence(bench: Bench) -> None:
    bench.budget = 50
    registry = bench.registry()
    for id in ("a", "nowhere"):
        with pytest.raises(TigasError) as failure:
            await registry.load(id)
        assert failure.value.detail.endswith(".")
