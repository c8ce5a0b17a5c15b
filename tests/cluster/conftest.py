"""A director before two hosts."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest

from tests.cluster.hosts import FakeFleet, asking_director, host


@pytest.fixture
def fleet() -> FakeFleet:
    return FakeFleet(host("a"), host("b"))


@pytest.fixture
async def client(fleet: FakeFleet, hosts: httpx.AsyncBaseTransport) -> AsyncIterator[httpx.AsyncClient]:
    """Client of a director with hosts that answer like the test's own `hosts`."""
    async with asking_director(fleet, transport=hosts) as client:
        yield client
