"""An engine with frames under the test's control, and a connected edge."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.render.pipe.pipe_bench import Edge, Engine
from tests.render.transport.client import FakeFrames
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.server import PipeServer


@pytest.fixture
def frames() -> FakeFrames:
    return FakeFrames()


@pytest.fixture
def engine(tmp_path: Path, frames: FakeFrames) -> Engine:
    """Not running yet."""
    return Engine(tmp_path / "pipe", frames)


@pytest.fixture
async def server(engine: Engine) -> AsyncIterator[PipeServer]:
    async with engine.running() as server:
        yield server


@pytest.fixture
async def edge(engine: Engine, server: PipeServer) -> AsyncIterator[PipeClient]:
    async with Edge(engine.path).connected() as edge:
        yield edge
