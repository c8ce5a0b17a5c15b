"""Load on an engine over the CUDA rasteriser: how many frames a second it gives, and how late they are below that."""

from __future__ import annotations

import asyncio
import gc
import itertools
import math
import time
from dataclasses import dataclass

from benchmarks.views import centred_lens
from tigas_common.errors import Overloaded, Superseded
from tigas_common.pose import Pose
from tigas_common.wire.render import DEFAULT_LADDER, RenderRequest
from tigas_render.engine.engine import Engine
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.frame import Client
from tigas_render.raster.base import PreparedScene, Rasterizer


@dataclass(frozen=True)
class OneScene:
    """The engine's view of the only scene."""

    prepared: PreparedScene
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ladder: None = None
    is_coarse: bool = False

    def use(self, scene_id: str, *, coarse: bool = False) -> OneScene:
        return self

    def enter_if_loaded(self) -> OneScene:
        return self

    async def enter(self) -> OneScene:
        return self

    def leave(self) -> None:
        pass

    def evict(self) -> bool:
        return False


async def throughput(rasterizer: Rasterizer, scene: PreparedScene, pose: Pose, seconds: float) -> None:
    requests = itertools.cycle(orbit(pose))
    gc.collect()
    gc.freeze()  # as the service does
    for clients in (8, 32, 64):
        async with Engine(rasterizer, OneScene(scene), DEFAULT_LADDER, EngineMetrics(), time.perf_counter) as engine:
            done, _ = await closed_loop(engine, requests, clients, seconds)
            print(f"  {clients} clients, each asks again at once: {done / seconds:.0f} frames/s")
    best = done / seconds
    for share in (0.5, 0.8):
        async with Engine(rasterizer, OneScene(scene), DEFAULT_LADDER, EngineMetrics(), time.perf_counter) as engine:
            times, lost = await open_loop(engine, requests, share * best, seconds)
            ranks = ", ".join(f"p{rank} {times[rank * len(times) // 100]:.2f} ms" for rank in (50, 95, 99))
            print(f"  {share:.0%} of that, {share * best:.0f} frames/s from 200 clients: {ranks}; {lost} refused")


def orbit(pose: Pose) -> list[RenderRequest]:
    """Views around the start, a little to each side."""
    lens = centred_lens(1280, 720)
    forward = tuple(row[2] for row in pose.rotation)
    azimuth = math.degrees(math.atan2(forward[0], forward[2]))
    elevation = math.degrees(math.asin(-forward[1]))
    return [
        RenderRequest.at("scene", Pose.from_euler(*angles, 0.0, pose.position), lens, profile=1)
        for step in range(100)
        for angles in [(azimuth + 5 * math.sin(step), elevation + 3 * math.cos(step))]
    ]


async def closed_loop(
    engine: Engine, requests: itertools.cycle[RenderRequest], clients: int, seconds: float
) -> tuple[int, float]:
    """Frames received by clients that request the next one as soon as they have one."""
    end = time.perf_counter() + seconds
    done = 0

    async def client(name: str) -> None:
        nonlocal done
        while time.perf_counter() < end:
            await engine.submit(Client(name, name), next(requests), time.monotonic())
            done += 1

    started = time.perf_counter()
    await asyncio.gather(*(client(f"client {number}") for number in range(clients)))
    return done, time.perf_counter() - started


async def open_loop(
    engine: Engine, requests: itertools.cycle[RenderRequest], rate: float, seconds: float
) -> tuple[list[float], int]:
    """Milliseconds of frames requested at a fixed rate, independent of earlier answers."""
    times: list[float] = []
    lost = 0

    async def one(client: str, due: float) -> None:
        nonlocal lost
        try:
            await engine.submit(Client(client, client), next(requests), time.monotonic())
        except (Overloaded, Superseded):
            lost += 1
        else:
            times.append(1000 * (time.perf_counter() - due))

    started = time.perf_counter()
    async with asyncio.TaskGroup() as group:
        for number in range(int(rate * seconds)):
            due = started + number / rate
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            group.create_task(one(f"client {number % 200}", due))
    return sorted(times), lost
