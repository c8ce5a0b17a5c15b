"""While a big scene is loaded, viewers of others have their frames, and memory stays near the scene's size."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.prerequisites import LINUX
from tests.render.fakes import render_request
from tests.render.scenes import plys
from tests.render.scenes.big_scenes import loaded_in_a_process
from tests.render.scenes.registry_bench import Bench
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine.engine import Engine
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.frame import Client
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.scene_file import Listener
from tigas_render.scenes.source import SceneMetadata, SceneSource


@pytest.mark.anyio
async def test_others_have_frames_while_a_scene_is_read_and_packed() -> None:
    """The big scene's next batch comes after another frame of the small one: if either waited, both would forever."""
    bench = Bench()
    bench.add("small", 100)
    frames = threading.Semaphore(0)
    read = threading.Semaphore(0)

    def open(listener: Listener) -> Batches:
        return Batches(4000, parts())

    def parts() -> Iterator[Gaussians]:
        for seed in range(4):
            yield plys.gaussians(1000, seed=seed)
            read.release()
            assert frames.acquire(timeout=60)

    bench.builtin["big"] = SceneSource("big", SceneMetadata(), "1", open, sh_degree=0, memory_bytes=4000)
    rasterizer = CpuRasterizer()
    rasterizer.warm_up()
    registry = SceneRegistry(
        None, rasterizer.pack, builtin=bench.builtin, memory_budget=10**8, idle_s=60, clock=time.monotonic
    )
    async with Engine(rasterizer, registry, DEFAULT_LADDER, EngineMetrics(), time.monotonic) as engine:
        viewer, newcomer = Client("here", "viewer"), Client("there", "newcomer")
        awaited = asyncio.create_task(engine.submit(newcomer, render_request(scene="big"), time.monotonic()))
        for _ in range(4):
            assert await asyncio.to_thread(read.acquire, timeout=60)
            async with asyncio.timeout(60):
                frame = await engine.submit(viewer, render_request(scene="small"), time.monotonic())
            assert frame.body
            assert registry.info("big").state == "loading"
            frames.release()
        assert (await awaited).body
        assert registry.info("big").gaussians == 4000


@pytest.mark.slow
@LINUX.mark
@pytest.mark.parametrize(("format", "degree"), [("ply", 3), ("spz", 3), ("sog", 3), ("sog", 0)])
@pytest.mark.extended
def test_loading_takes_at_most_one_and_a_half_times_what_is_kept(tmp_path: Path, format: str, degree: int) -> None:
    packed, peak = loaded_in_a_process(tmp_path, format, 1_500_000, degree)
    assert packed < peak <= 1.5 * packed
