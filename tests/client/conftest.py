"""A render service on sockets of its own, over HTTP/1.1 and HTTP/3, with one scene that can be seen: a red wall."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import pytest

from reference.ply import write_ply
from tests.render.arrays import gaussians_of
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.runner import serve_http
from tigas_render.raster.devices import create_rasterizer
from tigas_render.server.app import create_app
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_render.transport.certificate import Certificate
from tigas_render.transport.server import Http3Server

CERTIFICATE = Certificate.create([], datetime.now(UTC))
CAMERA = {"position": [0, 0, 0], "look_at": [0, 0, 3]}


def write_wall(models: Path) -> None:
    """One large red Gaussian, three units in front of the start camera."""
    (models / "wall").mkdir(parents=True)
    wall = gaussians_of(
        means=[[0.0, 0.0, 3.0]],
        scales=[[5.0, 5.0, 5.0]],
        quaternions=[[1.0, 0.0, 0.0, 0.0]],
        opacities=[0.999],
        sh=[[[1.7, -1.7, -1.7]]],
    )
    write_ply(models / "wall" / "wall.ply", wall)
    (models / "wall" / "scene.json").write_text(json.dumps({"camera": CAMERA, "background": [0, 0, 1]}))


@dataclass
class Served:
    """A running service."""

    url: str
    service: RenderService
    http3: AsyncExitStack
    """Closed, HTTP/3 ends."""


@pytest.fixture
async def served(tmp_path: Path) -> AsyncIterator[Served]:
    write_wall(tmp_path / "models")
    settings = RenderSettings(scenes=tmp_path / "models", cache=tmp_path / "cache")
    async with (
        RenderService.open(settings, create_rasterizer("cpu")) as service,
        AsyncExitStack() as http3,
        serve_http(app := create_app(service), Address("127.0.0.1", 0), HttpLimits()) as port,
    ):
        server = await http3.enter_async_context(Http3Server(app, host="127.0.0.1", certificate=CERTIFICATE))
        service.quic_port = server.port
        service.set_certificate(CERTIFICATE)
        yield Served(f"http://127.0.0.1:{port}", service, http3)
