"""However an edge behaves, the engine frees its resources, cancels its work, and serves the others."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import random
import resource
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from tests.eventually import eventually
from tests.render.engine_bench import Bench, busy
from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import VIEWER, Edge, Engine, Pipe
from tests.render.transport.client import FakeFrames
from tigas_common.errors import Overloaded
from tigas_render.pipe import link
from tigas_render.pipe import server as server_module
from tigas_render.pipe.link import PREFIX, Kind, encode_message
from tigas_render.pipe.messages import pack_request
from tigas_render.pipe.server import serve_edges

pytestmark = pytest.mark.anyio

REQUEST = pack_request(9, VIEWER, 0.0, 0.0, render_request())

CRASHING = """
import socket, sys, time
with socket.socket(socket.AF_UNIX) as sock:
    sock.connect(sys.argv[1])
    sock.sendall(bytes.fromhex(sys.argv[2]))
    time.sleep(60)
"""


async def test_an_edge_that_is_killed_frees_its_arena_and_its_work(pipe: Pipe) -> None:
    pipe.frames.held = {2}
    asked = [pack_request(seq, VIEWER, 0.0, 0.0, render_request(seq=seq)) for seq in (1, 2)]
    sent = b"".join(asked).hex()  # a frame that is never released, and one that is rendered
    crashing = await asyncio.create_subprocess_exec(sys.executable, "-c", CRASHING, str(pipe.engine.path), sent)
    try:
        await eventually(lambda: len(pipe.frames.requests) == 2)
        (crashed,) = (each for each in pipe.server.edges if each.running)
        await eventually(lambda: crashed.arena.used_bytes > 0)
    finally:
        crashing.send_signal(signal.SIGKILL)
        await crashing.wait()
    await eventually(lambda: pipe.frames.cancelled == [2])
    assert len(pipe.server.edges) == 1
    with pytest.raises(ValueError, match="closed"):
        crashed.arena.write(b"frame")
    assert await pipe.works()


async def test_withdrawing_through_the_pipe_takes_work_out_of_the_schedule(tmp_path: Path) -> None:
    bench = Bench()
    engine = Engine(tmp_path / "pipe", bench.engine)
    async with bench.engine, engine.running(), Edge(engine.path).connected() as edge:
        rendered = await busy(bench)
        withdrawn = asyncio.create_task(edge.submit(VIEWER, render_request(), bench.now))
        await bench.waiting(1)
        withdrawn.cancel()
        await eventually(lambda: len(bench.engine._queue) == 0)
        bench.rasterizer.gate.set()
        await rendered
    assert len(bench.rasterizer.cameras) == 1
    assert bench.scenes.users == 0


async def test_a_frame_that_finds_no_room_is_refused_until_there_is_some(engine: Engine, frames: FakeFrames) -> None:
    frames.body = random.Random(3).randbytes(300_000)
    engine.arena_bytes = 300_032
    async with engine.running() as server, Edge(engine.path).connected() as edge:
        pipe = Pipe(frames, engine, server, edge)
        kept = await pipe.submit()
        with pytest.raises(Overloaded, match="no room"):
            await pipe.submit()
        assert kept.body == frames.body
        kept.release()
        (await pipe.submit()).release()
        frames.body += bytes(100)
        with pytest.raises(Overloaded, match="no room"):
            await pipe.submit()
        assert await pipe.works()


async def test_what_waits_in_the_pipe_counts_in_the_queues_age(engine: Engine) -> None:
    told = Edge(engine.path)
    async with engine.running(), told.connected():
        await eventually(lambda: told.states)
        assert told.states[-1][0] == 0.25, "the renderer's own queue"
        _, writer = await asyncio.open_unix_connection(engine.path)
        writer.write(pack_request(9, VIEWER, 0.0, time.monotonic() - 2.5, render_request()))
        await eventually(lambda: told.states[-1][0] >= 2.5)
        await eventually(lambda: told.states[-1][0] == 0.25)
        writer.close()


@pytest.mark.parametrize(
    "hostile", [encode_message(Kind.FRAME), encode_message(Kind.RELEASE, 64), PREFIX.pack(1, Kind.REQUEST) + b"?"]
)
async def test_what_is_no_request_ends_that_pipe(pipe: Pipe, hostile: bytes, caplog: pytest.LogCaptureFixture) -> None:
    pipe.frames.held = True
    reader, writer = await asyncio.open_unix_connection(pipe.engine.path)
    writer.write(hostile)
    with contextlib.suppress(ConnectionResetError):
        await asyncio.wait_for(reader.read(), 20)
    writer.close()
    assert "was not understood" in caplog.text
    assert await pipe.works()


async def test_an_edge_that_never_reads_is_given_up(
    pipe: Pipe, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link, "MAX_UNSENT", 100_000)
    pipe.frames.error = Overloaded("." * 3_000_000)
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.connect(str(pipe.engine.path))
        deaf.sendall(REQUEST)
        await eventually(lambda: "does not read" in caplog.text and len(pipe.server.edges) == 1)


async def test_twenty_edges_come_and_go_and_nothing_stays(engine: Engine) -> None:
    gc.collect()
    before = _descriptors()
    for _ in range(20):
        async with engine.running() as serving, Edge(engine.path).connected() as edge:
            await edge.submit(VIEWER, render_request(), 0.0)
        await eventually(lambda serving=serving: not serving.edges)  # type: ignore[misc]
    assert _descriptors() <= before
    assert "tigas frames" not in _mapped()


async def test_edges_are_connected_again_after_file_descriptors_ran_out(
    pipe: Pipe, caplog: pytest.LogCaptureFixture
) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with socket.socket(socket.AF_UNIX) as waiting:
        resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
        try:
            waiting.connect(str(pipe.engine.path))
            await eventually(lambda: "Too many open files" in caplog.text)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        async with Edge(pipe.engine.path).connected() as edge:
            assert (await edge.submit(VIEWER, render_request(), 0.0)).body == b"frame"


async def test_an_edge_that_cannot_be_connected_leaves_no_descriptor(
    pipe: Pipe, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "ACCEPT_RETRY_S", 0.001)
    gc.collect()
    before = _descriptors()
    for count in range(1, 6):
        with socket.socket(socket.AF_UNIX) as gone:
            gone.connect(str(pipe.engine.path))  # closed before the engine accepts it
        await eventually(lambda count=count: len(caplog.records) == count)  # type: ignore[misc]
    assert _descriptors() == before


async def test_the_engine_ends_if_it_cannot_report_its_state(engine: Engine) -> None:
    def state() -> tuple[float, float]:
        raise RuntimeError("The state is unknown.")

    with pytest.RaisesGroup(RuntimeError):
        async with serve_edges(engine.path, engine.source, state, lambda *_: None):
            async with asyncio.timeout(20):
                await asyncio.Event().wait()


def _descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _mapped() -> str:
    return Path("/proc/self/maps").read_text(encoding="utf-8")
