"""What tests of the engine share."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from tests.render.engine_bench import Bench


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    bench = Bench()
    async with bench.engine:
        yield bench
        bench.rasterizer.gate.set()
