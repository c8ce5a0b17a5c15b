"""An engine with frames under the test's control."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.render.pipe.pipe_bench import Edge, Engine, Pipe
from tests.render.transport.client import FakeFrames


@pytest.fixture
def frames() -> FakeFrames:
    return FakeFrames()


@pytest.fixture
def engine(tmp_path: Path, frames: FakeFrames) -> Engine:
    """Not running yet."""
    return Engine(tmp_path / "pipe", frames)


@pytest.fixture
async def pipe(frames: FakeFrames, engine: Engine) -> AsyncIterator[Pipe]:
    async with engine.running() as server, Edge(engine.path).connected() as edge:
        yield Pipe(frames, engine, server, edge)
