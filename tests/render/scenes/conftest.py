"""Fixtures for the registry."""

from __future__ import annotations

import pytest

from tests.render.scenes.registry_bench import Bench


@pytest.fixture
def bench() -> Bench:
    """Three scenes that are loaded without files."""
    bench = Bench()
    for id in ("a", "b", "c"):
        bench.add(id)
    return bench
