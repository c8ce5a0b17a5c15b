"""A service that lets pages change its models directory."""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple

import httpx
import pytest

from tests.render.fakes import FakeRasterizer
from tests.render.scenes import plys
from tigas_common.address import Address
from tigas_common.limits import HttpLimits
from tigas_common.offload import Limit, Offload
from tigas_common.runner import serve_http
from tigas_render.server.app import create_app
from tigas_render.server.library import SceneLibrary
from tigas_render.server.service import RenderService
from tigas_render.settings import RenderSettings
from tigas_render.uploads.parts import FOLDER_NAME


@pytest.fixture
def models(tmp_path: Path) -> Path:
    directory = tmp_path / "models"
    plys.write(directory / "attic.ply", plys.binary_ply())
    return directory


def settings_for(models: Path, **changes: Any) -> RenderSettings:
    return RenderSettings(scenes=models, cache=Path("/nonexistent"), **changes)


T = TypeVar("T")
Ts = TypeVarTuple("Ts")


async def in_a_thread(function: Callable[[*Ts], T], *arguments: *Ts, limit: Limit | None = None) -> T:
    """Replaces the worker process, which takes seconds to start."""
    return await asyncio.to_thread(function, *arguments)


@asynccontextmanager
async def serving(settings: RenderSettings, offload: Offload = in_a_thread) -> AsyncIterator[httpx.AsyncClient]:
    """A client of a service, over a socket."""
    async with RenderService.open(settings, FakeRasterizer()) as service:
        service.library = SceneLibrary(settings, service.registry, service.weights, offload)
        async with (
            serve_http(create_app(service), Address("127.0.0.1", 0), HttpLimits()) as port,
            httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60) as client,
        ):
            yield client


@pytest.fixture
async def client(models: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with serving(settings_for(models)) as client:
        yield client


def left(models: Path) -> list[str]:
    """Files other than scenes."""
    return [path.name for path in (models / FOLDER_NAME).iterdir()] if (models / FOLDER_NAME).exists() else []


def names(models: Path) -> list[str]:
    return sorted(path.name for path in models.iterdir())


def inodes(*paths: Path) -> set[int]:
    return {path.stat().st_ino for path in paths}


async def ids(client: httpx.AsyncClient) -> list[str]:
    return [scene["id"] for scene in (await client.get("/scenes")).json()]


def problem(answer: httpx.Response) -> tuple[int, str]:
    """The status and type of a refusal."""
    return answer.status_code, answer.json()["type"].removeprefix("tigas:")


def fail(*_: object, **__: object) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))
