"""An edge gets the engine's answers through the pipe, and survives the engine."""

from __future__ import annotations

import asyncio
import logging
import random
import socket
from dataclasses import replace
from pathlib import Path

import pytest

from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import Edge, Engine
from tests.render.transport.client import TIMING, FakeFrames
from tests.render.transport.serving import eventually
from tigas_common.errors import Overloaded, TigasError
from tigas_common.wire.render import RenderRequest, VideoRequest
from tigas_render.frame import Client, Frame
from tigas_render.pipe import client as client_module
from tigas_render.pipe import messages
from tigas_render.pipe.arena import Arena
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.link import Kind, framed
from tigas_render.pipe.server import PipeServer

pytestmark = pytest.mark.anyio

VIEWER = Client("192.0.2.1", "viewer")
REQUEST = render_request(scene="größer/ohne Maß", roll=-12.5, overscan=0.15, depth=True, deadline_ms=0.5)


def video_request(seq: int) -> RenderRequest:
    return render_request(seq=seq, format="h264", video=VideoRequest(bitrate_kbps=1000))


@pytest.mark.parametrize("request_", [REQUEST, video_request(2)], ids=["still", "video"])
async def test_a_request_and_its_frame_are_what_they_are_without_a_pipe(
    edge: PipeClient, frames: FakeFrames, request_: RenderRequest
) -> None:
    frames.body = random.Random(1).randbytes(100_000)
    through, direct = await edge.submit(VIEWER, request_, 12.5), await frames.submit(VIEWER, request_, 12.5)
    assert frames.requests[0][1] == frames.requests[1][1]
    assert frames.arrivals == [12.5, 12.5]
    assert bytes(through.body) == direct.body
    through.release()
    assert replace(through, body=direct.body, on_release=None) == direct


async def test_an_error_is_what_it_is_without_a_pipe(edge: PipeClient, frames: FakeFrames) -> None:
    frames.error = Overloaded("A sentence.", retry_after_s=2.5)
    with pytest.raises(Overloaded, match="A sentence") as caught:
        await edge.submit(VIEWER, render_request(), 0.0)
    assert vars(caught.value) == vars(frames.error)


async def test_a_bug_in_the_engine_fails_one_request_and_tells_nothing(
    edge: PipeClient, frames: FakeFrames, caplog: pytest.LogCaptureFixture
) -> None:
    frames.error = KeyError("secret")
    with pytest.raises(TigasError, match="its log says why"):
        await edge.submit(VIEWER, render_request(), 0.0)
    assert "secret" in caplog.text
    frames.error = None
    assert (await edge.submit(VIEWER, render_request(seq=3), 0.0)).seq == 3


async def test_a_withdrawn_request_is_withdrawn_in_the_engine(edge: PipeClient, frames: FakeFrames) -> None:
    frames.held = True
    task = asyncio.create_task(edge.submit(VIEWER, render_request(seq=5), 0.0))
    await frames.until(lambda: frames.requests)
    task.cancel()
    await frames.until(lambda: frames.cancelled == [5])


async def test_frames_that_were_on_their_way_when_they_were_withdrawn_leave_no_trace_and_videos_begin_anew(
    edge: PipeClient, server: PipeServer, frames: FakeFrames
) -> None:
    frames.held = True
    answers: list[object] = []
    requests = (render_request(), video_request(5))
    withdraws = [edge.request(VIEWER, request, 0.0, answers.append) for request in requests]
    await frames.until(lambda: len(frames.requests) == 2)
    assert edge._link is not None
    assert edge._link._transport is not None
    edge._link._transport.pause_reading()
    for request in requests:
        frames.release(request.seq)
    (link,) = server.edges
    await eventually(lambda: not link.running)
    assert link.arena.used > 0
    for withdraw in (*withdraws, *withdraws):
        withdraw()
    edge._link._transport.resume_reading()
    await eventually(lambda: link.arena.used == 0 and frames.forgotten)
    assert answers == []
    assert frames.forgotten == [frames.requests[1][0]]


async def test_a_video_ends_with_its_session_and_may_begin_again(edge: PipeClient, frames: FakeFrames) -> None:
    await edge.submit(VIEWER, video_request(1), 0.0)
    edge.forget(VIEWER)
    edge.forget(VIEWER)
    edge.forget(Client("192.0.2.2", "unheard of"))
    await edge.submit(VIEWER, video_request(2), 0.0)
    assert frames.forgotten == [frames.requests[0][0]] == [frames.requests[1][0]]


async def test_videos_end_with_their_edge(engine: Engine, frames: FakeFrames) -> None:
    async with engine.running(), Edge(engine.path).connected() as edge:
        await edge.submit(VIEWER, video_request(1), 0.0)
    assert frames.forgotten == [frames.requests[0][0]]


async def test_a_thousand_requests_at_once_get_each_its_own_answer(
    edge: PipeClient, server: PipeServer, frames: FakeFrames, caplog: pytest.LogCaptureFixture
) -> None:
    chance = random.Random(7)
    frames.held = True
    frames.body = bytes(300)
    order = chance.sample(range(1000), 1000)
    tasks = {
        seq: asyncio.create_task(edge.submit(Client(f"192.0.2.{seq % 7}", f"{seq % 31}"), render_request(seq=seq), 0.0))
        for seq in order
    }
    await frames.until(lambda: len(frames.requests) == 1000)
    withdrawn = set(chance.sample(order, 300))
    for seq in chance.sample(order, 1000):
        if seq in withdrawn:
            tasks[seq].cancel()
        else:
            frames.release(seq)
    for seq in set(order) - withdrawn:
        frame = await tasks[seq]
        assert frame.seq == seq
        frame.release()
    await frames.until(lambda: set(frames.cancelled) == withdrawn)
    (link,) = server.edges
    await eventually(lambda: link.arena.used == 0 and not link.running)
    assert len({client for client, _ in frames.requests}) == 217, "sessions stay apart"
    assert caplog.records == []


async def test_sessions_that_ask_no_more_are_forgotten_but_may_come_back(
    edge: PipeClient, frames: FakeFrames, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "KNOWN_SESSIONS", 2)
    for session in "abcab":
        (await edge.submit(Client("192.0.2.1", session), render_request(), 0.0)).release()
    sessions = [client.session for client, _ in frames.requests]
    assert sessions[:2] == sessions[3:]
    assert len(set(sessions)) == 3


async def test_sessions_of_two_edges_are_two_even_if_their_names_are_the_same(
    engine: Engine, edge: PipeClient, frames: FakeFrames
) -> None:
    async with Edge(engine.path, 1).connected() as other:
        for each in (edge, other):
            (await each.submit(VIEWER, render_request(), 0.0)).release()
    clients = [client for client, _ in frames.requests]
    assert {client.address for client in clients} == {VIEWER.address}
    assert len({client.session for client in clients}) == 2


async def test_while_the_engine_is_gone_requests_are_refused_and_later_they_are_answered(
    engine: Engine, frames: FakeFrames
) -> None:
    edge = Edge(engine.path)
    frames.held = {1}
    async with engine.running() as server, edge.connected() as client:
        held = asyncio.create_task(client.submit(VIEWER, render_request(seq=1), 0.0))
        await frames.until(lambda: frames.requests)
        kept = await client.submit(VIEWER, render_request(seq=2), 0.0)
        server.close()
        with pytest.raises(Overloaded, match="starting again") as caught:
            await held
        assert caught.value.retry_after_s == 1
        with pytest.raises(Overloaded):  # at once, whether or not the loss has been dealt with
            await client.submit(VIEWER, render_request(), 0.0)
        assert kept.body == b"frame", "what was received can still be read"
        kept.release()
        await eventually(lambda: client.is_connected)
        assert (await client.submit(VIEWER, render_request(seq=3), 0.0)).body == b"frame"


async def test_an_edge_may_start_before_the_engine(engine: Engine) -> None:
    async with PipeClient(engine.path, 0, lambda *_: None) as client:
        with pytest.raises(Overloaded):
            await client.submit(VIEWER, render_request(), 0.0)
        async with asyncio.timeout(20), engine.running():
            await eventually(lambda: client.is_connected)
            assert (await client.submit(VIEWER, render_request(), 0.0)).body == b"frame"


async def test_edges_hear_how_busy_the_engine_is_and_tell_it_what_they_measure(
    engine: Engine, server: PipeServer
) -> None:
    edge = Edge(engine.path, 3)
    async with edge.connected() as client:
        client.tell(b'{"viewers": 7}')
        await eventually(lambda: edge.states and engine.stats)
    age, utilisation = edge.states[0]
    assert age == 0.25
    assert 0.5 <= utilisation <= 1
    assert engine.stats == [(3, b'{"viewers": 7}')]


async def test_a_callback_that_fails_does_not_break_the_pipe(
    edge: PipeClient, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(answer: Frame | Exception) -> None:
        raise RuntimeError("broken")

    edge.request(VIEWER, render_request(), 0.0, fail)
    (await edge.submit(VIEWER, render_request(), 0.0)).release()
    assert "An answer was not delivered" in caplog.text


@pytest.mark.parametrize(
    ("hostile", "sentence"),
    [
        (framed(Kind.FRAME, b"short"), "5 bytes instead of"),
        (messages.pack_frame(0, Frame(bytes(10), "jpeg", 1, 1, 0, None, TIMING), 60), "beyond the end"),
        (framed(Kind.REQUEST, b""), "kind 4 is expected"),
        (b"\xff\xff\xff\xff\x11", "4294967295 bytes is too long"),
    ],
)
async def test_what_is_no_answer_ends_the_pipe_in_a_sentence(
    tmp_path: Path, hostile: bytes, sentence: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    path, arena = tmp_path / "pipe", Arena(64)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        async with PipeClient(path, 0, lambda *_: None) as client:
            engine, _ = await asyncio.to_thread(listener.accept)
            with engine:
                socket.send_fds(engine, [messages.pack_number(Kind.ARENA, 64)], [arena.fd])
                await eventually(lambda: client.is_connected)
                engine.sendall(hostile)
                await eventually(lambda: sentence in caplog.text)
    arena.close()


async def test_whoever_drops_a_frame_without_a_word_takes_no_room_for_ever(engine: Engine, frames: FakeFrames) -> None:
    async with engine.running() as serving, Edge(engine.path).connected() as edge:
        kept, dropped = [await edge.submit(VIEWER, render_request(), 0.0) for _ in range(2)]
        (link,) = serving.edges
        both = link.arena.used
        del dropped
        edge.request(VIEWER, render_request(), 0.0, lambda answer: None)
        await eventually(lambda: len(frames.requests) == 3 and link.arena.used == both / 2)
        assert kept.body == b"frame"
        kept.release()
        kept.release()
        await eventually(lambda: link.arena.used == 0)
        assert (await edge.submit(VIEWER, render_request(), 0.0)).body == b"frame"
