"""An engine over stand-ins for the rasteriser and the scenes, with a clock that the test sets."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from prometheus_client import CollectorRegistry

from tests.eventually import eventually
from tests.render.fakes import FakeRasterizer, FakeScenes, render_request
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.engine.engine import Engine
from tigas_render.engine.metrics import EngineMetrics
from tigas_render.frame import Client, Frame


@dataclass
class Bench:
    """Requests go in by `submit`; `rasterizer.gate` lets them be rendered."""

    rasterizer: FakeRasterizer = field(default_factory=FakeRasterizer)
    scenes: FakeScenes = field(default_factory=FakeScenes)
    metrics: EngineMetrics = field(default_factory=EngineMetrics)
    now: float = 1000.0

    def __post_init__(self) -> None:
        self.engine = Engine(self.rasterizer, self.scenes, DEFAULT_LADDER, self.metrics, lambda: self.now)

    async def rendering(self) -> None:
        """Wait until the rasteriser has begun one more frame."""
        assert await asyncio.to_thread(self.rasterizer.started.acquire, True, 10)

    def submit(
        self, session: str, *, address: str = "somewhere", waited: float = 0.0, **changes: object
    ) -> asyncio.Task[Frame]:
        """A request received this many seconds ago."""
        client = Client(address, session)
        return asyncio.create_task(self.engine.submit(client, render_request(**changes), self.now - waited))

    async def waiting(self, count: int) -> None:
        """Wait until this many requests are queued."""
        await eventually(lambda: len(self.engine._queue) == count)

    async def idle(self) -> None:
        """Wait until the renderer has nothing to do."""
        await eventually(lambda: self.engine._queue._utilisation._idle_since is not None)

    def outcome(self, name: str) -> float:
        registry = CollectorRegistry()
        registry.register(self.metrics)
        return registry.get_sample_value("tigas_render_requests_total", {"outcome": name}) or 0.0


async def busy(bench: Bench) -> asyncio.Task[Frame]:
    """Keep the rasteriser busy with a frame, so that further requests are queued."""
    task = bench.submit("somebody else")
    await bench.rendering()
    return task
