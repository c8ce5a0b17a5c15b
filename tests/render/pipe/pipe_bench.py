"""An engine's end of the pipe in this process, and edges that connect to it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.eventually import eventually
from tests.render.fakes import render_request
from tests.render.transport.client import FakeFrames
from tigas_common.wire.render import RenderRequest, VideoRequest
from tigas_render.admission.load import LoadState
from tigas_render.frame import Client, Frame, FrameSource
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.server import EdgeLink, PipeServer, serve_edges

VIEWER = Client("192.0.2.1", "viewer")


@dataclass
class Engine:
    """The engine's end, and its received messages."""

    path: Path
    source: FrameSource
    arena_bytes: int = 1024 * 1024
    stats: list[tuple[int, LoadState]] = field(default_factory=list)

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


@dataclass
class Pipe:
    """A running engine with frames under the test's control, and a connected edge."""

    frames: FakeFrames
    engine: Engine
    server: PipeServer
    edge: PipeClient

    @property
    def link(self) -> EdgeLink:
        """The engine's end of the only pipe."""
        (link,) = self.server.edges
        return link

    async def submit(self, client: Client = VIEWER, **changes: Any) -> Frame:
        return await self.edge.submit(client, render_request(**changes), 0.0)

    async def works(self) -> bool:
        """Whether a frame arrives."""
        self.frames.body, self.frames.error, self.frames.held = b"works", None, False
        return (await self.submit()).body == b"works"


def video_request(seq: int) -> RenderRequest:
    return render_request(seq=seq, format="h264", video=VideoRequest(bitrate_kbps=1000))
