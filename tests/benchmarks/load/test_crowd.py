"""Processes of viewers against the real HTTP/3 server."""

from __future__ import annotations

import asyncio
import time

import pytest

from benchmarks.load.crowd import Crowds
from benchmarks.load.plan import Plan
from benchmarks.load.step import Observed
from tests.benchmarks.load.test_viewer import POSES, VIEW
from tests.render.transport.client import FakeFrames
from tests.render.transport.serving import served

pytestmark = pytest.mark.anyio


@pytest.mark.slow
async def test_viewers_of_several_processes_are_counted_together() -> None:
    source = FakeFrames(bytes(20_000))
    times: list[float] = []

    def wait(until: float) -> None:
        times.append(until)
        time.sleep(max(0.0, until - time.monotonic()))

    async with served(source=source) as server:
        plan = Plan("127.0.0.1", server.port, "mixed", 20, VIEW, (POSES,))

        def measure() -> Observed:
            with Crowds(plan, 2) as crowds:
                crowds.measure(1, 0.1, 0.2, wait)
                times.clear()
                return crowds.measure(3, 0.2, 1.0, wait)

        observed = await asyncio.to_thread(measure)
    assert sum(observed.fates.values()) == pytest.approx(3 * 20, abs=3)
    assert len(observed.served) == observed.fates["served"] > 30
    assert (observed.outside, len(observed.cpu), len(times)) == (0, 2, 2)
    assert len({client.address for client, _ in source.requests}) == 2  # the third asks by POST


async def test_a_process_that_has_ended_is_noticed() -> None:
    with Crowds(Plan("127.0.0.1", 9, "webtransport", 20, VIEW, (POSES,)), 1) as crowds:
        crowds._processes[0].kill()
        crowds._processes[0].wait()
        with pytest.raises(RuntimeError, match=r"^A process of viewers has ended\.$"):
            crowds.measure(1, 0.1, 0.1, lambda until: None)
