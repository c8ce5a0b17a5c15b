"""While a big scene is loaded, viewers of others have their frames, and memory stays near the scene's size."""

from __future__ import annotations

import asyncio
import gzip
import io
import json
import math
import multiprocessing
import re
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray
from PIL import Image

from reference.ply import write_ply
from tests.prerequisites import LINUX
from tests.render.arrays import gaussians_of
from tests.render.fakes import render_request
from tests.render.scenes import plys
from tests.render.scenes.registry_bench import Bench
from tests.render.scenes.test_formats import spz_bytes
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine.engine import Engine
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.frame import Client
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.local_files import cache_directory
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.raster.devices import create_rasterizer
from tigas_render.scenes.directory import read_scene_file
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
            assert registry.scene_info("big").state == "loading"
            frames.release()
        assert (await awaited).body
        assert registry.scene_info("big").gaussians == 4000


@pytest.mark.slow
@LINUX.mark
@pytest.mark.parametrize(("format", "degree"), [("ply", 3), ("spz", 3), ("sog", 3), ("sog", 0)])
@pytest.mark.extended
def test_loading_takes_at_most_one_and_a_half_times_what_is_kept(tmp_path: Path, format: str, degree: int) -> None:
    path, scene = tmp_path / f"hills.{format}", hills(1_500_000, degree)
    WRITERS[format](path, scene)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        packed, peak = pool.apply(load, (plys.write(tmp_path / "small.ply", plys.binary_ply(1000, degree)), path))
    assert packed < peak <= 1.5 * packed


def load(small: Path, path: Path) -> tuple[int, int]:
    """Bytes of a scene once packed, and the peak while it is loaded, after another has loaded what it needs."""
    rasterizer = create_rasterizer("cpu", cache_directory())
    rasterizer.pack(read_scene_file(small).open(lambda _: None))
    before = psutil.Process().memory_info().rss
    scene = rasterizer.pack(read_scene_file(path).open(lambda _: None))
    # for this program: getrusage would include its parent process
    found = re.search(r"^VmHWM:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert found is not None
    return scene.nbytes, 1024 * int(found[1]) - before


def hills(count: int, degree: int) -> Gaussians:
    """Discs on hills, unordered."""
    random = np.random.default_rng(0)
    x, z = random.uniform(-50, 50, (2, count))
    y = 2 * np.sin(x / 7) * np.cos(z / 9) + random.normal(0, 0.05, count)
    quaternions = random.normal(0, 1, (count, 4))
    return gaussians_of(
        means=np.column_stack((x, y, z)),
        scales=100 / np.sqrt(count) * np.exp(random.normal(0, 0.3, (count, 3))),
        quaternions=quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        opacities=1 / (1 + np.exp(-random.normal(1, 1, count))),
        sh=random.normal(0, 0.2, (count, (degree + 1) ** 2, 3)),
    )


def write_sog(path: Path, scene: Gaussians) -> None:
    """Of degree 0, or with a palette that has one entry for all."""
    count, (scales, colours) = len(scene), (np.linspace(-12, 2, 256), np.linspace(-2, 2, 256))
    width = -(-math.isqrt(count) // 4) * 4 + 4
    logarithms = np.sign(scene.means) * np.log1p(np.abs(scene.means))
    places = np.rint((logarithms + 4) / 8 * 65535).clip(0, 65535).astype(np.int64)
    rotations = np.column_stack((scene.quaternions[:, 1:] * 90 + 128, np.full(count, 252)))
    opaque = np.column_stack((np.digitize(scene.sh[:, 0], colours[1:]), scene.opacities * 255))
    images = {
        "means_l": places & 255,
        "means_u": places >> 8,
        "scales": np.digitize(np.log(scene.scales), scales[1:]),
        "quats": rotations,
        "sh0": opaque,
    }
    meta: dict[str, Any] = {
        "version": 2,
        "count": count,
        "means": {"mins": [-4.0] * 3, "maxs": [4.0] * 3, "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scales.tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colours.tolist(), "files": ["sh0.webp"]},
    }
    if scene.sh_degree:
        palette = {"count": 1, "bands": scene.sh_degree, "codebook": colours.tolist()}
        meta["shN"] = {**palette, "files": ["centroids.webp", "labels.webp"]}
        images["labels"] = np.zeros((count, 3))
    with zipfile.ZipFile(path, "w") as bundle:

        def add(name: str, pixels: NDArray[Any]) -> None:
            content = io.BytesIO()
            Image.fromarray(pixels.astype(np.uint8)).save(
                content, "webp", lossless=True, quality=0, method=0, exact=True
            )
            bundle.writestr(f"{name}.webp", content.getvalue())

        for name, rows in images.items():
            whole = np.zeros((-(-count // width) * width, rows.shape[1]))
            whole[:count] = rows
            add(name, whole.reshape(-1, width, rows.shape[1]))
        add("centroids", np.full((1, 64 * ((scene.sh_degree + 1) ** 2 - 1 or 1), 3), 128))
        bundle.writestr("meta.json", json.dumps(meta))


WRITERS: dict[str, Callable[[Path, Gaussians], object]] = {
    "ply": write_ply,
    "spz": lambda path, scene: path.write_bytes(gzip.compress(spz_bytes(scene), 1)),
    "sog": write_sog,
}
