"""An engine's end of the pipe in this process, and edges that connect to it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.render.transport.serving import eventually
from tigas_render.frame import FrameSource
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.server import PipeServer, serve_edges


@dataclass
class Engine:
    """The engine's end, and its received messages."""

    path: Path
    source: FrameSource
    arena_bytes: int = 1024 * 1024
    stats: list[tuple[int, bytes]] = field(default_factory=list)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[PipeServer]:
        async with serve_edges(
            self.path,
            self.source,
            lambda: (0.25, 0.5),
            lambda edge, told: self.stats.append((edge, told)),
            arena_bytes=self.arena_bytes,
        ) as server:
            yield server


@dataclass
class Edge:
    """An edge's end, and its received messages."""

    path: Path
    number: int = 0
    states: list[tuple[float, float]] = field(default_factory=list)

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[PipeClient]:
        async with PipeClient(self.path, self.number, lambda *state: self.states.append(state)) as client:
            await eventually(lambda: client.is_connected)
            yield client
