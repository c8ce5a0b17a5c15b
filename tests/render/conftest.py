"""What tests of the engine share."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from tests.render.engine_bench import Bench
from tests.render.fakes import FakeLaneRasterizer, FakeRasterizer


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """An engine renders by threads and, unless a test is marked `threads`, by lanes."""
    if "bench" in metafunc.fixturenames:
        kinds = {"threads": FakeRasterizer, "lanes": FakeLaneRasterizer}
        if metafunc.definition.get_closest_marker("threads"):
            del kinds["lanes"]
        metafunc.parametrize("bench", list(kinds.values()), ids=list(kinds), indirect=True)


@pytest.fixture
async def bench(request: pytest.FixtureRequest) -> AsyncIterator[Bench]:
    bench = Bench(request.param())
    async with bench.engine:
        yield bench
        bench.rasterizer.gate.set()
