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

from tests.render.engine_bench import Bench, busy
from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import Edge, Engine
from tests.render.transport.client import FakeFrames
from tests.render.transport.serving import eventually
from tigas_common.errors import Overloaded
from tigas_render.frame import Client
from tigas_render.pipe import link, messages
from tigas_render.pipe import server as server_module
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.link import PREFIX, Kind, framed
from tigas_render.pipe.server import PipeServer, serve_edges

pytestmark = pytest.mark.anyio

VIEWER = Client("192.0.2.1", "viewer")
OPEN = messages.pack_number(Kind.OPEN, 0)
HELLO = messages.pack_hello(1, VIEWER)
REQUEST = messages.pack_request(9, 1, 0.0, 0.0, render_request())

CRASHING = """
import asyncio, sys
from pathlib import Path
from tests.render.fakes import render_request
from tigas_common.errors import Overloaded
from tigas_render.frame import Client
from tigas_render.pipe.client import PipeClient

async def main():
    async with PipeClient(Path(sys.argv[1]), 0, lambda *_: None) as client:
        while not client.is_connected:
            await asyncio.sleep(0.01)
        viewer = Client("192.0.2.1", "viewer")
        kept = await client.submit(viewer, render_request(seq=1), 0.0)  # never released
        client.request(viewer, render_request(seq=2), 0.0, print)
        await asyncio.sleep(60)

asyncio.run(main())
"""


async def test_an_edge_that_is_killed_frees_its_arena_and_its_work(engine: Engine, frames: FakeFrames) -> None:
    frames.held = {2}
    async with engine.running() as serving, Edge(engine.path, 1).connected() as other:
        crashing = await asyncio.create_subprocess_exec(sys.executable, "-c", CRASHING, str(engine.path))
        try:
            await frames.until(lambda: len(frames.requests) == 2)
            (crashed,) = (each for each in serving.edges if each.running)
            assert crashed.arena.used > 0
        finally:
            crashing.send_signal(signal.SIGKILL)
            await crashing.wait()
        await frames.until(lambda: frames.cancelled == [2])
        assert len(serving.edges) == 1
        with pytest.raises(ValueError, match="closed"):
            crashed.arena.write(b"frame")
        assert (await other.submit(VIEWER, render_request(), 0.0)).body == b"frame"


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


async def test_a_full_arena_sends_frames_through_the_socket_until_that_is_full_too(
    engine: Engine, frames: FakeFrames, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "MOST_QUEUED", 400_000)
    frames.body = random.Random(3).randbytes(300_000)
    engine.arena_bytes = 300_032
    async with engine.running(), Edge(engine.path).connected() as edge:
        kept = await edge.submit(VIEWER, render_request(), 0.0)
        inline = await edge.submit(VIEWER, render_request(), 0.0)
        assert (type(kept.body), type(inline.body)) == (memoryview, bytes)
        assert kept.body == inline.body == frames.body
        inline.release()
        kept.release()
        assert isinstance((await edge.submit(VIEWER, render_request(), 0.0)).body, memoryview)

        # an edge that does not read
        with socket.socket(socket.AF_UNIX) as deaf:
            deaf.connect(str(engine.path))
            asked = [messages.pack_request(id, 1, 0.0, 0.0, render_request(seq=id)) for id in range(20)]
            before = len(frames.requests)
            deaf.sendall(b"".join((OPEN, HELLO, *asked)))
            await frames.until(lambda: len(frames.requests) == before + 20)
            deaf.settimeout(20)
            kinds = await asyncio.to_thread(_kinds, deaf, 20)
    assert kinds.count(Kind.FRAME) == 1
    assert kinds.count(Kind.INLINE) >= 1
    assert kinds.count(Kind.FAILURE) >= 15, "refused at once, and nothing waits without a bound"


async def test_what_waits_in_the_pipe_counts_in_the_queues_age(engine: Engine) -> None:
    told = Edge(engine.path)
    async with engine.running(), told.connected():
        await eventually(lambda: told.states)
        assert told.states[-1][0] == 0.25, "the renderer's own queue"
        _, writer = await asyncio.open_unix_connection(engine.path)
        late = messages.pack_request(9, 1, 0.0, time.monotonic() - 2.5, render_request())
        writer.write(OPEN + HELLO + late)
        await eventually(lambda: told.states[-1][0] >= 2.5)
        await eventually(lambda: told.states[-1][0] == 0.25)
        writer.close()


def _kinds(sock: socket.socket, answers: int) -> list[int]:
    """Kinds of the following answers, without the arena and the engine's state."""
    kinds: list[int] = []
    with sock.makefile("rb") as stream:
        while len(kinds) < answers:
            length, kind = PREFIX.unpack(stream.read(5))
            stream.read(length)
            if kind not in (Kind.ARENA, Kind.STATE):
                kinds.append(kind)
    return kinds


@pytest.mark.parametrize(
    ("hostile", "why"),
    [
        (HELLO, "kind 2 is expected"),
        (OPEN + framed(Kind.FRAME, b""), "kind 17 is expected"),
        (OPEN + framed(Kind.REQUEST, b"short"), "5 bytes instead of"),
        (OPEN + REQUEST, "has no session"),
        (OPEN + HELLO + REQUEST + REQUEST, "the number of one that runs"),
        (OPEN + HELLO + HELLO, "introduced twice"),
        (OPEN + messages.pack_number(Kind.BYE, 1), "not introduced"),
        (OPEN + messages.pack_number(Kind.RELEASE, 64), "was not taken"),
        (OPEN + b"\x01\x00\x01\x00\x04", "65537 bytes is too long"),
    ],
)
async def test_what_is_no_request_ends_that_pipe_in_a_sentence(
    engine: Engine, edge: PipeClient, frames: FakeFrames, hostile: bytes, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    frames.held = True
    reader, writer = await asyncio.open_unix_connection(engine.path)
    writer.write(hostile)
    with contextlib.suppress(ConnectionResetError):
        await asyncio.wait_for(reader.read(), 20)
    writer.close()
    await eventually(lambda: why in caplog.text)
    assert [record.levelname for record in caplog.records] == ["ERROR"]
    frames.held = False
    assert (await edge.submit(VIEWER, render_request(), 0.0)).body == b"frame"


async def test_an_edge_that_never_reads_is_given_up(
    engine: Engine,
    server: PipeServer,
    frames: FakeFrames,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(link, "MOST_UNSENT", 100_000)
    frames.body = bytes(3_000_000)
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.connect(str(engine.path))
        deaf.sendall(OPEN + HELLO + REQUEST)
        await frames.until(lambda: frames.requests)
        await eventually(lambda: "does not read" in caplog.text and not server.edges)


async def test_a_frame_too_large_for_arena_and_socket_is_refused_and_the_pipe_lives(
    edge: PipeClient, frames: FakeFrames
) -> None:
    frames.body = bytes(server_module.MOST_QUEUED + 1)
    with pytest.raises(Overloaded, match="no room"):
        await edge.submit(VIEWER, render_request(), 0.0)
    frames.body = b"frame"
    assert (await edge.submit(VIEWER, render_request(), 0.0)).body == b"frame"


async def test_twenty_edges_come_and_go_and_nothing_stays(engine: Engine) -> None:
    gc.collect()
    before = _descriptors()
    for _ in range(20):
        async with engine.running() as serving, Edge(engine.path).connected() as edge:
            await edge.submit(VIEWER, render_request(), 0.0)
        await eventually(lambda serving=serving: not serving.edges)  # type: ignore[misc]
    assert _descriptors() <= before
    assert "tigas frames" not in _mapped()


@pytest.mark.usefixtures("server")
async def test_edges_are_connected_again_after_file_descriptors_ran_out(
    engine: Engine, caplog: pytest.LogCaptureFixture
) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with socket.socket(socket.AF_UNIX) as waiting:
        resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
        try:
            waiting.connect(str(engine.path))
            await eventually(lambda: "Too many open files" in caplog.text)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        async with Edge(engine.path).connected() as edge:
            assert (await edge.submit(VIEWER, render_request(), 0.0)).body == b"frame"


@pytest.mark.usefixtures("server")
async def test_an_edge_that_cannot_be_connected_leaves_no_descriptor(
    engine: Engine, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "ACCEPT_AGAIN_S", 0.001)
    gc.collect()
    before = _descriptors()
    for count in range(1, 6):
        with socket.socket(socket.AF_UNIX) as gone:
            gone.connect(str(engine.path))  # closed before the engine accepts it
        await eventually(lambda count=count: len(caplog.records) == count)  # type: ignore[misc]
    assert _descriptors() == before


async def test_the_engine_ends_if_it_cannot_report_its_state(tmp_path: Path) -> None:
    def state() -> tuple[float, float]:
        raise RuntimeError("The state is unknown.")

    with pytest.RaisesGroup(RuntimeError):
        async with serve_edges(tmp_path / "pipe", FakeFrames(), state, lambda *_: None):
            async with asyncio.timeout(20):
                await asyncio.Event().wait()


def _descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def _mapped() -> str:
    return Path("/proc/self/maps").read_text(encoding="utf-8")
