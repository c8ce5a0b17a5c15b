"""Breaks the GPU's context under a running service and prints its answers.

A separate program, since its process cannot use the GPU afterwards. Run by `test_service_on_gpu.py`.
"""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import suppress
from pathlib import Path

import httpx
import torch
from cuda.core import Device, LaunchConfig, Program, ProgramOptions, launch

from tests.render.fakes import render_request
from tigas_render.raster.devices import create_rasterizer
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings

BAD = 'extern "C" __global__ void write_nowhere() { *reinterpret_cast<volatile int*>(16) = 1; }'


def break_the_device() -> None:
    """An illegal write: every later call in this process fails."""
    device = Device(0)
    device.set_current()
    major, minor = device.compute_capability
    module = Program(BAD, "c++", ProgramOptions(arch=f"sm_{major}{minor}")).compile("cubin")
    stream = device.create_stream()
    launch(stream, LaunchConfig(grid=1, block=1), module.get_kernel("write_nowhere"))
    with suppress(Exception):
        stream.sync()
    with suppress(RuntimeError):
        torch.cuda.synchronize()


async def main(cache: Path) -> None:
    service = RenderService(RenderSettings(cache=cache), create_rasterizer("cuda", cache))
    async with service.engine:
        await service.registry.scan()
        transport = httpx.ASGITransport(create_app(service), raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost", timeout=60) as client:
            request = render_request(scene="courtyard").model_dump(mode="json", exclude_none=True)
            before = await client.post("/render", json=request)
            break_the_device()
            async with asyncio.timeout(30):
                after = [await client.post("/render", json=request) for _ in range(3)]
                healthy = await client.get("/scenes")
    answers = {"before": before.status_code, "after": [a.json() for a in after], "scenes": healthy.status_code}
    print(json.dumps(answers), flush=True)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
