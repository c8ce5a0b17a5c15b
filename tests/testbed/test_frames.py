"""Frames over the shaped link, through the render service's own transport. Frames are synthetic, so that only the
network is measured.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from tests.render.transport.client import CERTIFICATE, Client, FakeFrames, connect, request_body
from tests.testbed.inside import inside, retried_on_a_busy_machine
from tests.testbed.labs import ShaperProcess
from tigas_common.topology import WEBTRANSPORT
from tigas_common.wire.render import DEFAULT_LADDER
from tigas_render.transport.frames import render_session
from tigas_render.transport.server import Http3Server
from tigas_testbed.namespaces import Lab

Result = TypeVar("Result")


async def no_app(scope: object, receive: object, send: object) -> None:
    """HTTP is not used here."""


@contextmanager
def frame_server(lab: Lab, size: int) -> Iterator[None]:
    """Answers every request in the service's namespace at once with this many bytes."""
    ready, loop, stop = threading.Event(), asyncio.new_event_loop(), asyncio.Event()

    async def serve() -> None:
        sessions = {"/render": render_session(FakeFrames(bytes(size)))}
        server = Http3Server(
            no_app, host="0.0.0.0", port=WEBTRANSPORT.number, certificate=CERTIFICATE, webtransport=sessions
        )
        async with server:
            ready.set()
            await stop.wait()

    def run() -> None:
        with inside(lab, "service"):
            loop.run_until_complete(serve())
            loop.close()

    running = threading.Thread(target=run)
    running.start()
    assert ready.wait(10)
    try:
        yield
    finally:
        loop.call_soon_threadsafe(stop.set)
        running.join()


def at_client(lab: Lab, work: Callable[[Client, int], Awaitable[Result]]) -> Result:
    """Run `work` with a WebTransport session that the client opened at its own 127.0.0.1, as the page does."""

    async def session() -> Result:
        async with connect(WEBTRANSPORT.number) as client:
            return await work(client, await client.connect_webtransport())

    with inside(lab, "client"):
        return asyncio.run(session())


async def frames_per_second(client: Client, session: int, in_flight: int, warm_up_s: float, seconds: float) -> float:
    """Frames received with a constant number in flight."""
    start = time.monotonic() + warm_up_s
    arrived = 0

    async def keep_asking() -> None:
        nonlocal arrived
        while (now := time.monotonic()) < start + seconds:
            header, _ = await client.frame(session, request_body(profile=2))
            assert header["status"] == 200
            arrived += now >= start

    await asyncio.gather(*(keep_asking() for _ in range(in_flight)))
    return arrived / seconds


@retried_on_a_busy_machine
def test_the_frame_rate_does_not_depend_on_the_round_trip(link: ShaperProcess) -> None:
    """300 ms of round trip, 20 Mbit/s, frames of profile 2."""
    link.post("/link", down_kbps=20_000, up_kbps=10_000, delay_ms=150)
    with frame_server(link.lab, round(DEFAULT_LADDER[2].expected_kb * 1000)):
        one = at_client(link.lab, lambda client, session: frames_per_second(client, session, 1, 1, 2))
        many = at_client(link.lab, lambda client, session: frames_per_second(client, session, 16, 3, 3))
    print(f"{one:.1f} frames/s with one request in flight, {many:.1f} with 16")
    assert one < 4
    assert many > 25


@retried_on_a_busy_machine
def test_a_lost_packet_holds_up_its_own_frame_only(link: ShaperProcess) -> None:
    """Later frames overtake those that lost a packet, which is impossible in one ordered stream of bytes."""
    period, count = 0.03, 150
    link.post("/link", down_kbps=20_000, up_kbps=10_000, delay_ms=30, loss_pct=1)

    async def ask_steadily(client: Client, session: int) -> list[tuple[float, float]]:
        start = time.monotonic()

        async def frame(number: int) -> tuple[float, float]:
            asked = start + number * period
            await asyncio.sleep(asked - time.monotonic())
            await client.frame(session, request_body(seq=number))
            return asked, time.monotonic()

        return await asyncio.gather(*map(frame, range(count)))

    with frame_server(link.lab, 3_000):
        times = at_client(link.lab, ask_steadily)
    overtaken = [index for index in range(count - 1) if times[index + 1][1] < times[index][1] - period / 2]
    late = sorted((arrived - asked) * 1e3 for asked, arrived in times)
    print(f"{len(overtaken)} frames were overtaken; median {late[count // 2]:.0f} ms, last {late[-1]:.0f} ms")
    assert overtaken
    next_ones = [(times[index + 1][1] - times[index + 1][0]) * 1e3 for index in overtaken]
    assert min(next_ones) < 100, "the frame after one that lost a packet takes a round trip, as if nothing had happened"
