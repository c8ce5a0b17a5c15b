"""Fixtures for tests of the engine."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from tests.render.engine_bench import Bench
from tests.render.fakes import FakeLaneRasterizer, FakeRasterizer


@pytest.fixture(params=[FakeRasterizer, FakeLaneRasterizer], ids=["threads", "lanes"])
async def bench(request: pytest.FixtureRequest) -> AsyncIterator[Bench]:
    """A running engine, once over each frame maker."""
    async with running(request.param()) as bench:
        yield bench


@pytest.fixture
async def thread_bench() -> AsyncIterator[Bench]:
    """A running engine that renders on threads."""
    async with running(FakeRasterizer()) as bench:
        yield bench


@asynccontextmanager
async def running(rasterizer: FakeRasterizer) -> AsyncIterator[Bench]:
    """A bench with a running engine; at the end the rasteriser's gate is opened."""
    bench = Bench(rasterizer)
    async with bench.engine:
        yield bench
        rasterizer.gate.set()
