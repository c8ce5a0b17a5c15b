"""The service on a real GPU: its formats, and its answers when the GPU is full or broken."""

from __future__ import annotations

import asyncio
import gc
import io
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import torch
from PIL import Image

from reference.ply import write_ply
from tests.prerequisites import GPU
from tests.render.fakes import render_request
from tests.render.raster.views import cloud, psnr
from tigas_render.raster.devices import create_rasterizer
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

pytestmark = [
    pytest.mark.anyio,
    GPU.mark,
    pytest.mark.timeout(400),
]
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A large scene, and one too small to be shown coarsely while it loads."""
    directory = tmp_path_factory.mktemp("models")
    for name, count in (("large", 10_000_000), ("small", 500_000)):
        (directory / name).mkdir()
        write_ply(directory / name / f"{name}.ply", cloud(count, 0))
    return directory


@asynccontextmanager
async def serving(cache: Path, **settings: Any) -> AsyncIterator[httpx.AsyncClient]:
    async with RenderService.open(RenderSettings(cache=cache, **settings), create_rasterizer("cuda", cache)) as service:
        transport = httpx.ASGITransport(create_app(service), raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost", timeout=120) as client:
            yield client


@pytest.fixture
async def client(models: Path, tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with serving(tmp_path, scenes=models) as client:
        yield client


LITTLE = 4 * 2**20
"""Bytes."""


class Fill:
    """Takes all of the GPU's memory but a little, again and again, until it is released."""

    def __init__(self) -> None:
        self._taken: list[torch.Tensor] = []

    def __call__(self) -> None:
        gc.collect()  # another test's service would give its memory back later
        torch.cuda.empty_cache()
        free, _ = torch.cuda.mem_get_info()
        sizes = [max(0, free - LITTLE), *(LITTLE << power for power in range(6, -1, -1))]
        for size in sizes:  # after the first, the free memory between PyTorch's own blocks
            with suppress(torch.cuda.OutOfMemoryError):
                while size:
                    self._taken.append(torch.empty(size, dtype=torch.uint8, device="cuda"))

    def release(self) -> None:
        """Give everything back."""
        self._taken.clear()
        torch.cuda.empty_cache()


@pytest.fixture
def fill() -> Iterator[Fill]:
    """A way to fill the GPU, for one test."""
    filling = Fill()
    yield filling
    filling.release()


async def frame(client: httpx.AsyncClient, scene: str, **changes: Any) -> httpx.Response:
    request = render_request(scene=scene, **changes)
    return await client.post("/render", json=request.model_dump(mode="json", exclude_none=True))


async def test_every_format_shows_the_same_view(client: httpx.AsyncClient) -> None:
    async def body(**changes: Any) -> bytes:
        return (await frame(client, "courtyard", profile=None, **changes)).content

    png = np.asarray(Image.open(io.BytesIO(await body(format="png"))).convert("RGB"))
    jpeg = Image.open(io.BytesIO(await body())).convert("RGB")
    assert psnr(np.asarray(jpeg), png) > 25
    assert len(await body(format="yuv420p")) == png.shape[0] * png.shape[1] * 3 // 2


async def test_a_full_gpu_unloads_unused_scenes_then_refuses(client: httpx.AsyncClient, fill: Fill) -> None:
    assert (await frame(client, "large")).status_code == 200
    fill()
    answer = await frame(client, "small")
    assert answer.status_code == 200, answer.text
    states = {scene["id"]: scene["state"] for scene in (await client.get("/scenes")).json()}
    assert (states["large"], states["small"]) == ("unloaded", "loaded")
    fill()
    answer = await frame(client, "large")
    assert (answer.status_code, answer.json()["type"]) == (503, "tigas:out-of-memory"), answer.text
    assert "memory" in answer.json()["detail"]


async def test_a_gpu_that_has_room_again_is_used_again(client: httpx.AsyncClient, fill: Fill) -> None:
    fill()
    assert (await frame(client, "large")).status_code == 503
    fill.release()
    assert (await frame(client, "large")).status_code == 200


def test_a_broken_gpu_is_an_answer_and_not_a_hang(tmp_path: Path) -> None:
    """In a process of its own, which cannot use the GPU afterwards."""
    program = f"import asyncio; from {__name__} import lose; asyncio.run(lose({str(tmp_path)!r}))"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr


async def lose(cache: str) -> None:
    """Break the GPU's context under a running service, by an illegal write: every later call in the process fails."""
    from cuda.core import Device, LaunchConfig, Program, ProgramOptions, launch

    code = 'extern "C" __global__ void write_nowhere() { *reinterpret_cast<volatile int*>(16) = 1; }'
    async with serving(Path(cache)) as client:
        assert (await frame(client, "courtyard")).status_code == 200
        device = Device(0)
        device.set_current()
        major, minor = device.compute_capability
        module = Program(code, "c++", ProgramOptions(arch=f"sm_{major}{minor}")).compile("cubin")
        stream = device.create_stream()
        launch(stream, LaunchConfig(grid=1, block=1), module.get_kernel("write_nowhere"))
        with suppress(Exception):
            stream.sync()
        with suppress(RuntimeError):
            torch.cuda.synchronize()
        async with asyncio.timeout(30):
            answers = [(await frame(client, "courtyard")).json()["type"] for _ in range(3)]
            assert answers == ["tigas:device-lost"] * 3
            assert (await client.get("/scenes")).status_code == 200
