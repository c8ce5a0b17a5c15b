"""An edge gets the engine's answers through the pipe, and survives the engine."""

from __future__ import annotations

import asyncio
import random
import socket
from dataclasses import replace

import pytest

from tests.eventually import eventually
from tests.render.fakes import render_request
from tests.render.pipe.pipe_bench import VIEWER, Edge, Engine, Pipe, video_request
from tigas_common.errors import DeviceLost, NoRoom, Overloaded, TigasError
from tigas_common.wire.render import RenderRequest
from tigas_render.admission.load import Load
from tigas_render.encode.h264 import EncodingFailed
from tigas_render.frame import Client, Frame
from tigas_render.pipe.arena import FD_MESSAGE, Arena
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.link import PREFIX, Kind, encode_message
from tigas_render.scenes.entry import LoadingEnded

pytestmark = pytest.mark.anyio

REQUEST = render_request(scene="größer/ohne Maß", roll=-12.5, overscan=0.15, depth=True, deadline_ms=0.5)


@pytest.mark.parametrize("request_", [REQUEST, video_request(2)], ids=["still", "video"])
async def test_a_request_and_its_frame_are_what_they_are_without_a_pipe(pipe: Pipe, request_: RenderRequest) -> None:
    pipe.frames.body = random.Random(1).randbytes(100_000)
    through, direct = [await source.submit(VIEWER, request_, 12.5) for source in (pipe.edge, pipe.frames)]
    assert pipe.frames.requests[0][1] == pipe.frames.requests[1][1]
    assert pipe.frames.arrivals == [12.5, 12.5]
    assert bytes(through.body) == direct.body
    through.release()
    assert replace(through, body=direct.body, on_release=None) == direct


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (Overloaded("A sentence – with a dash.", retry_after_s=2.5), Overloaded),
        (NoRoom("A sentence – with a dash."), NoRoom),
        (DeviceLost("A sentence – with a dash."), DeviceLost),
        (LoadingEnded("A sentence – with a dash."), Overloaded),
        (EncodingFailed("A sentence – with a dash."), TigasError),
    ],
    ids=lambda each: type(each).__name__ if isinstance(each, TigasError) else "",
)
async def test_an_error_is_what_it_is_without_a_pipe(pipe: Pipe, error: TigasError, kind: type[TigasError]) -> None:
    pipe.frames.error = error
    with pytest.raises(TigasError, match="A sentence – with a dash") as caught:
        await pipe.submit()
    assert type(caught.value) is kind
    assert vars(caught.value) == vars(error)


async def test_a_bug_tells_nothing(pipe: Pipe, caplog: pytest.LogCaptureFixture) -> None:
    pipe.frames.error = KeyError("secret")
    with pytest.raises(TigasError, match="its log says why"):
        await pipe.submit()
    assert "secret" in caplog.text
    assert await pipe.works()


async def test_frames_that_were_on_their_way_when_they_were_withdrawn_leave_no_trace_and_videos_begin_anew(
    pipe: Pipe,
) -> None:
    pipe.frames.held = True
    answers: list[object] = []
    requests = (render_request(), video_request(5))
    cancels = [pipe.edge.request(VIEWER, request, 0.0, answers.append) for request in requests]
    await eventually(lambda: len(pipe.frames.requests) == 2)
    assert pipe.edge._link is not None
    assert pipe.edge._link._transport is not None
    pipe.edge._link._transport.pause_reading()
    for request in requests:
        pipe.frames.release(request.seq)
    await eventually(lambda: not pipe.link.running)
    assert pipe.link.arena.used_bytes > 0
    for cancel in (*cancels, *cancels):
        cancel()
    pipe.edge._link._transport.resume_reading()
    await eventually(lambda: pipe.link.arena.used_bytes == 0 and pipe.frames.forgotten)
    assert answers == []
    assert pipe.frames.forgotten == [pipe.frames.requests[1][0]]


async def test_a_video_ends_with_its_session_and_may_begin_again(pipe: Pipe) -> None:
    await pipe.edge.submit(VIEWER, video_request(1), 0.0)
    pipe.edge.forget(VIEWER)
    await pipe.edge.submit(VIEWER, video_request(2), 0.0)
    assert pipe.frames.forgotten == [pipe.frames.requests[0][0]] == [pipe.frames.requests[1][0]]


async def test_a_thousand_requests_at_once_get_each_its_own_answer(
    pipe: Pipe, caplog: pytest.LogCaptureFixture
) -> None:
    chance = random.Random(7)
    pipe.frames.held = True
    pipe.frames.body = bytes(300)
    order = chance.sample(range(1000), 1000)
    clients = [Client(f"192.0.2.{seq % 7}", f"{seq % 31}") for seq in range(1000)]
    tasks = {seq: asyncio.create_task(pipe.submit(clients[seq], seq=seq)) for seq in order}
    await eventually(lambda: len(pipe.frames.requests) == 1000)
    withdrawn = set(chance.sample(order, 300))
    for seq in chance.sample(order, 1000):
        if seq in withdrawn:
            tasks[seq].cancel()
        else:
            pipe.frames.release(seq)
    for seq in set(order) - withdrawn:
        frame = await tasks[seq]
        assert frame.seq == seq
        frame.release()
    await eventually(lambda: set(pipe.frames.cancelled) == withdrawn)
    await eventually(lambda: pipe.link.arena.used_bytes == 0 and not pipe.link.running)
    assert len({client for client, _ in pipe.frames.requests}) == 217, "sessions stay apart"
    assert caplog.records == []


async def test_sessions_of_two_edges_are_two_even_if_their_names_are_the_same(pipe: Pipe) -> None:
    async with Edge(pipe.engine.path, 1).connected() as other:
        for each in (pipe.edge, other):
            await each.submit(VIEWER, render_request(), 0.0)
    clients = [client for client, _ in pipe.frames.requests]
    assert {client.address for client in clients} == {VIEWER.address}
    assert len({client.session for client in clients}) == 2


async def test_while_the_engine_is_gone_requests_are_refused_and_later_they_are_answered(pipe: Pipe) -> None:
    pipe.frames.held = {1}
    held = asyncio.create_task(pipe.submit(seq=1))
    await eventually(lambda: pipe.frames.requests)
    kept = await pipe.submit(seq=2)
    pipe.server.close()
    with pytest.raises(Overloaded, match="restarting") as caught:
        await held
    assert caught.value.retry_after_s == 1
    with pytest.raises(Overloaded):  # at once, whether or not the loss has been dealt with
        await pipe.submit()
    assert kept.body == b"frame", "what was received can still be read"
    kept.release()
    await eventually(lambda: pipe.edge.is_connected)
    assert await pipe.works()


async def test_an_edge_may_start_before_the_engine(engine: Engine) -> None:
    async with PipeClient(engine.path, 0, lambda *_: None) as client:
        with pytest.raises(Overloaded):
            await client.submit(VIEWER, render_request(), 0.0)
        async with asyncio.timeout(20), engine.running():
            await eventually(lambda: client.is_connected)
            assert (await client.submit(VIEWER, render_request(), 0.0)).body == b"frame"


async def test_edges_hear_how_busy_the_engine_is_and_tell_it_what_they_measure(engine: Engine) -> None:
    edge = Edge(engine.path, 3)
    async with engine.running(), edge.connected() as client:
        client.send_stats(state := Load().state)
        await eventually(lambda: edge.states and engine.stats)
    age, utilisation = edge.states[0]
    assert age == 0.25
    assert 0.5 <= utilisation <= 1
    assert engine.stats == [(3, state)]


async def test_a_callback_that_fails_does_not_break_the_pipe(pipe: Pipe, caplog: pytest.LogCaptureFixture) -> None:
    def fail(answer: Frame | Exception) -> None:
        raise RuntimeError("broken")

    pipe.edge.request(VIEWER, render_request(), 0.0, fail)
    assert await pipe.works()
    assert "An answer was not delivered" in caplog.text


@pytest.mark.parametrize("hostile", [encode_message(Kind.REQUEST), PREFIX.pack(1, Kind.FRAME) + b"?"])
async def test_what_is_no_answer_ends_the_pipe(engine: Engine, hostile: bytes) -> None:
    arena = Arena(64)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(engine.path))
        listener.listen()
        async with PipeClient(engine.path, 0, lambda *_: None) as client:
            accepted, _ = await asyncio.to_thread(listener.accept)
            with accepted:
                socket.send_fds(accepted, [FD_MESSAGE], [arena.fd])
                await eventually(lambda: client.is_connected)
                accepted.sendall(hostile)
                await eventually(lambda: not client.is_connected)
    arena.close()


async def test_whoever_drops_a_frame_without_a_word_takes_no_room_for_ever(pipe: Pipe) -> None:
    kept, dropped = [await pipe.submit() for _ in range(2)]
    both = pipe.link.arena.used_bytes
    del dropped
    pipe.edge.request(VIEWER, render_request(), 0.0, lambda answer: None)
    await eventually(lambda: len(pipe.frames.requests) == 3 and pipe.link.arena.used_bytes == both / 2)
    assert kept.body == b"frame"
    kept.release()
    kept.release()
    await eventually(lambda: pipe.link.arena.used_bytes == 0)
    assert await pipe.works()
