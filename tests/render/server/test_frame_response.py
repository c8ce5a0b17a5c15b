"""Frames are sent without copies, and their memory is freed for any reader."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx
import pytest
from starlette.types import Message

from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import Edge, Engine
from tests.render.transport.client import FakeFrames
from tigas_common.address import Address
from tigas_common.http_limits import HttpLimits
from tigas_common.runner import serve_http
from tigas_common.wire.render import ServerTiming
from tigas_render.admission.http_viewers import HttpViewers
from tigas_render.admission.load import Load
from tigas_render.admission.request_rate import RequestRate
from tigas_render.frame import Frame
from tigas_render.server.frame_route import FrameResponse, HttpFrames, Lending, frames_app

pytestmark = pytest.mark.anyio


class Lent:
    """A frame of 100 bytes, and whether it was released."""

    def __init__(self) -> None:
        self.memory = bytearray(b"x" * 100)
        self.released = False
        timing = ServerTiming(queue=0, render=0, encode=0)
        self.frame = Frame(
            memoryview(self.memory), "jpeg", 1, 1, 0, None, timing, on_release=lambda: setattr(self, "released", True)
        )


class Reader:
    """Takes an answer's body on demand."""

    def __init__(self) -> None:
        self.reads = asyncio.Event()
        self.body: bytes | memoryview | None = None

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.body":
            self.body = message["body"]
            await self.reads.wait()

    async def receive(self) -> Message:
        raise NotImplementedError

    def answered(self, lent: Lent, lending: Lending) -> asyncio.Task[None]:
        response = FrameResponse(lent.frame, lending, {})
        return asyncio.create_task(response({"type": "http"}, self.receive, self.send))


async def test_slow_readers_hold_only_so_much_of_the_memory_that_all_frames_need() -> None:
    lending, frames, readers = Lending(most=250), [Lent() for _ in range(4)], [Reader() for _ in range(4)]
    answers = [reader.answered(lent, lending) for reader, lent in zip(readers, frames, strict=True)]
    await asyncio.sleep(0)
    assert [lent.released for lent in frames] == [False, False, True, True]
    assert [bytes(reader.body or b"") for reader in readers] == [b"x" * 100] * 4
    for reader in readers[:2]:
        reader.reads.set()
    await asyncio.gather(*answers[:2])
    assert all(lent.released for lent in frames)
    later = Lent()
    last = readers[3].answered(later, lending)
    await asyncio.sleep(0)
    assert not later.released
    for gone in (last, *answers[2:]):
        gone.cancel()
    await asyncio.gather(last, *answers[2:], return_exceptions=True)
    assert later.released, "its reader is gone"


async def test_a_posted_frame_comes_whole_from_shared_memory_and_leaves_none_taken(tmp_path: Path) -> None:
    source = FakeFrames(bytes(range(256)) * 1200)
    engine = Engine(tmp_path / "pipe", source)
    load = Load()
    async with engine.running() as serving, Edge(engine.path).connected() as edge:
        rate = RequestRate(load, 240, lambda: 0.0)
        app = frames_app(HttpFrames(edge, HttpViewers(load, lambda: 0.0), rate))
        async with (
            serve_http(app, Address("127.0.0.1", 0), HttpLimits()) as port,
            httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as client,
        ):
            for _ in range(5):
                answer = await client.post("/render", content=render_request().model_dump_json())
                assert answer.content == source.body
        (link,) = serving.edges
        async with asyncio.timeout(20):
            while link.arena.used:  # noqa: ASYNC110 - the edge tells of it with its next message
                await asyncio.sleep(0.001)
