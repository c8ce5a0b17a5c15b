"""While a big scene is loaded, viewers of others have their frames, and memory stays near what is kept of the scene."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.render.fakes import render_request
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine import Engine
from tigas_render.frame import Client
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.metrics import EngineMetrics
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.columns import Listener
from tigas_render.scenes.metadata import SceneMetadata
from tigas_render.scenes.registry import SceneRegistry
from tigas_render.scenes.source import SceneSource


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
@pytest.mark.skipif(sys.platform != "linux", reason="resident memory is that of Linux")
@pytest.mark.parametrize(("formats", "degree"), [("ply,spz,sog", "3"), ("sog", "0")])
def test_loading_takes_at_most_one_and_a_half_times_what_is_kept(formats: str, degree: str) -> None:
    made_up = ("--count", "1500000", "--degree", degree, "--formats", formats)
    command = [sys.executable, "-m", "benchmarks.big_scene", *made_up]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[3], check=False)
    assert done.returncode == 0, done.stdout + done.stderr
