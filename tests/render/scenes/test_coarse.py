"""Coarse scenes: a large one can be used before it is loaded, whatever becomes of its file and of the cache."""

from __future__ import annotations

import asyncio
import os
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from reference.ply import write_ply
from tests.render.scenes import made_up, plys
from tests.render.scenes.registry_bench import Packed
from tigas_common.errors import BrokenScene, NoRoom, OutOfDeviceMemory, SceneInUse, UnknownScene
from tigas_render.gaussians import Batches
from tigas_render.raster.base import PreparedScene
from tigas_render.scenes import coarse, scene_file
from tigas_render.scenes.coarse import CoarseSceneCache
from tigas_render.scenes.registry import SceneRegistry

pytestmark = pytest.mark.anyio
WHOLE, SAMPLE = 400, 100


@dataclass
class Bench:
    """A registry over files, in which packing the whole of a scene waits at a gate."""

    folder: Path
    budget: int = 10**6
    packed: list[int] = field(default_factory=list)
    started: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    gate: threading.Event = field(default_factory=threading.Event)
    coarse_error: Exception | None = None
    error: Exception | None = None

    def __post_init__(self) -> None:
        self.models, self.cache = self.folder / "models", self.folder / "cache"
        write_ply(plys.write(self.models / "large.ply", b""), plys.gaussians(WHOLE))

    async def registry(self) -> SceneRegistry:
        registry = SceneRegistry(
            self.models,
            self._pack,
            builtin={},
            coarse=CoarseSceneCache(self.cache),
            memory_budget=self.budget,
            idle_s=60,
            clock=lambda: 0.0,
        )
        await registry.scan()
        return registry

    async def loads(self) -> None:
        """Wait until the whole of a scene was read."""
        assert await asyncio.to_thread(self.started.acquire, timeout=10)

    def _pack(self, scene: Batches) -> PreparedScene:
        self.packed.append(count := len(scene.read_all()))
        if count < made_up.COUNT:
            if self.coarse_error is not None:
                raise self.coarse_error
            return Packed(count)
        self.started.release()
        assert self.gate.wait(10)
        if self.error is not None:
            raise self.error
        return Packed(count)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(coarse, "MIN_GAUSSIANS", made_up.COUNT)
    monkeypatch.setattr(scene_file, "SAMPLE", SAMPLE)
    return Bench(tmp_path)


async def test_two_viewers_see_a_large_scene_while_it_loads_once(bench: Bench) -> None:
    registry = await bench.registry()

    async def enter() -> tuple[bool, int]:
        async with registry.use("large", coarse=True) as scene:
            return scene.is_coarse, scene.gaussians

    assert set(await asyncio.gather(enter(), enter())) == {(True, SAMPLE)}
    use = registry.use("large", coarse=True)
    assert use.enter_if_loaded() is not None
    use.leave()
    assert registry.use("large").enter_if_loaded() is None
    assert (registry.scene_info("large").state, registry.scene_info("large").camera is None) == ("loading", False)
    await registry.load("large", coarse=True)
    loading = asyncio.create_task(registry.load("large"))
    await bench.loads()
    assert not loading.done()
    bench.gate.set()
    await loading
    assert await enter() == (False, WHOLE)
    assert bench.packed == [SAMPLE, WHOLE]
    assert not list(bench.cache.glob("*")), "its file can be read coarsely"


async def test_a_small_scene_is_loaded_at_once(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coarse, "MIN_GAUSSIANS", WHOLE + 1)
    bench.gate.set()
    async with (await bench.registry()).use("large", coarse=True) as scene:
        assert not scene.is_coarse
    assert bench.packed == [WHOLE]


@pytest.mark.parametrize("kept", ["a sample", "a torn one", "one of a former file", "one of a replaced file"])
async def test_of_a_packed_file_a_sample_is_kept(bench: Bench, monkeypatch: pytest.MonkeyPatch, kept: str) -> None:
    monkeypatch.setattr("tigas_render.scenes.registry.SceneStatistics.__init__.__defaults__", (SAMPLE,), raising=False)
    path = plys.write(bench.models / "shell.sog", (made_up.FILES / "shell.sog").read_bytes())
    registry = await bench.registry()
    bench.gate.set()
    async with registry.use("shell", coarse=True) as scene:
        assert not scene.is_coarse
    registry.unload("shell")
    (sample,) = bench.cache.glob("coarse-*")
    if kept == "a torn one":
        sample.write_bytes(sample.read_bytes()[:-1])
    elif kept != "a sample":
        os.utime(path, (1, 1))
    if kept == "one of a former file":
        registry = await bench.registry()
    async with registry.use("shell", coarse=True) as scene:
        assert scene.is_coarse == (kept == "a sample")
    async with registry.use("shell") as whole:
        assert not whole.is_coarse
    registry.unload("shell")
    async with registry.use("shell", coarse=True) as scene:
        assert scene.is_coarse == (kept != "one of a replaced file"), "it is written again"


async def test_a_scene_that_is_deleted_while_it_loads_leaves_nothing(bench: Bench) -> None:
    registry = await bench.registry()
    async with registry.use("large", coarse=True):
        await bench.loads()
        (bench.models / "large.ply").unlink()
        await registry.scan()
        with pytest.raises(UnknownScene):
            await registry.load("large", coarse=True)
        bench.gate.set()
    await asyncio.gather(*(task for task in asyncio.all_tasks() if task.get_name() == "load large"))
    assert registry.memory() == {}


async def test_a_file_that_ends_too_early_is_shown_no_more(bench: Bench) -> None:
    bench.error = BrokenScene("The file ends too early.")
    registry = await bench.registry()
    await registry.load("large", coarse=True)
    bench.gate.set()
    with pytest.raises(BrokenScene):
        await registry.load("large")
    with pytest.raises(BrokenScene, match="ends too early"):
        await registry.use("large", coarse=True).enter()
    assert registry.memory() == {}


@pytest.mark.parametrize("error", [BrokenScene("torn"), OSError("gone"), OutOfDeviceMemory("full")])
async def test_a_scene_that_cannot_be_shown_coarsely_is_loaded(bench: Bench, error: Exception) -> None:
    bench.coarse_error = error
    registry = await bench.registry()
    bench.gate.set()
    async with registry.use("large", coarse=True) as scene:
        assert not scene.is_coarse


async def test_a_scene_in_use_leaves_no_room_for_a_coarse_one_and_is_not_evicted_by_it(bench: Bench) -> None:
    write_ply(bench.models / "other.ply", plys.gaussians(WHOLE))
    bench.budget = 46 * WHOLE
    registry = await bench.registry()
    await registry.load("large", coarse=True)
    assert not registry.evict(), "it is loading"
    async with registry.use("large", coarse=True):
        with pytest.raises(SceneInUse):
            registry.unload("large")
        with pytest.raises(NoRoom):
            await asyncio.wait_for(registry.load("other", coarse=True), 10)
    bench.gate.set()
    await registry.load("large")
    assert registry.memory() == {"large": WHOLE}
