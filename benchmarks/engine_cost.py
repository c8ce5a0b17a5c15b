"""What a frame costs the engine's process in Python: a rasteriser that takes no time, and an edge behind the pipe.

python -m benchmarks.engine_cost [--viewers 72] [--seconds 10] [--threads]
python -m benchmarks.engine_cost --one-thread     # no sockets and no threads: what is left compares on a busy machine
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import uvloop
from numpy.typing import NDArray

from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import DEFAULT_LADDER, FrameFormat, RenderRequest
from tigas_render.engine import Engine
from tigas_render.frame import Client, Frame
from tigas_render.gaussians import Batches
from tigas_render.main import SWITCH_S
from tigas_render.metrics import EngineMetrics
from tigas_render.pipe import messages
from tigas_render.pipe.arena import Arena
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.framing import Kind, Splitter
from tigas_render.pipe.server import ARENA_BYTES, EdgeLink, PipeServer, serve_edges
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer
from tigas_render.raster.instant import InstantRasterizer
from tigas_render.render_threads import RenderThreads

FRAME_BYTES = 23_000
FRAMES_PER_S = 30
"""That each viewer asks for."""
VIEW = Pose.from_euler(10, 0, 0, (0.0, 0.0, 0.0))
LENS = Intrinsics(624, 624, 640, 360, 1280, 720)


class Scene(PreparedScene):
    """Nothing."""

    background = (0.0, 0.0, 0.0)
    ladder = None

    @property
    def nbytes(self) -> int:
        return 0

    @property
    def prepared(self) -> PreparedScene:
        return self

    def use(self, scene_id: str) -> Scene:
        return self

    def enter_if_loaded(self) -> Scene:
        return self

    async def enter(self) -> Scene:
        return self

    def leave(self) -> None:
        pass

    def evict(self) -> bool:
        return False


@dataclass
class Picture(Image):
    """Encoded already."""

    body: bytes

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        return self.body

    def to_host(self) -> NDArray[np.uint8]:
        raise NotImplementedError

    def close(self) -> None:
        pass


class Instant(Rasterizer):
    """Has as many frames in flight as the CUDA rasteriser, each made by a thread of Python's."""

    device = "instant"
    frames_in_flight = 6
    image = Picture(bytes(FRAME_BYTES))

    def pack(self, scene: Batches) -> PreparedScene:
        raise NotImplementedError

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        return self.image


async def measure(rasterizer: Rasterizer, viewers: int, addresses: int, seconds: float) -> None:
    """Serve an edge in a process of its own and tell what each of its frames costs here."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pipe"
        async with (
            Engine(rasterizer, Scene(), DEFAULT_LADDER, EngineMetrics(), time.monotonic) as engine,
            serve_edges(path, engine, engine.state, lambda *_: None),
        ):
            gc.collect()
            gc.freeze()  # as the service does, and:
            sys.setswitchinterval(SWITCH_S)
            before, of_loop = resource.getrusage(resource.RUSAGE_SELF), time.thread_time()
            load = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "benchmarks.engine_cost", "--edge", str(path),
                "--viewers", str(viewers), "--addresses", str(addresses), "--seconds", str(seconds),
                stdout=asyncio.subprocess.PIPE,
            )  # fmt: skip
            output, _ = await load.communicate()
            of_loop = time.thread_time() - of_loop
            after = resource.getrusage(resource.RUSAGE_SELF)
    frames, late, others = (float(number) for number in output.split())
    user, system = ((b - a) * 1e6 / frames for a, b in
                    ((before.ru_utime, after.ru_utime), (before.ru_stime, after.ru_stime)))  # fmt: skip
    switches = (after.ru_nvcsw - before.ru_nvcsw + after.ru_nivcsw - before.ru_nivcsw) / frames
    print(
        f"{viewers} viewers of {addresses} addresses, {frames / seconds:.0f} frames/s ({others:.0f} refused): "
        f"{user + system:.0f} µs a frame ({user:.0f} user, {system:.0f} system; "
        f"{of_loop * 1e6 / frames:.0f} on the event loop's thread), {switches:.1f} switches, "
        f"p95 {late:.1f} ms"
    )


class Edge(asyncio.Transport):
    """Takes whatever the engine answers, and gives the frames' room back."""

    def __init__(self) -> None:
        super().__init__()
        self.sent = b""

    def is_closing(self) -> bool:
        return False

    def get_write_buffer_size(self) -> int:
        return 0

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.sent += bytes(data)


BURST, BURSTS = 8, 2000


async def measure_one_thread(viewers: int) -> None:
    """Take requests, make their frames and answer them in turns; tell what the fastest burst took for each."""
    engine = Engine(Instant(), Scene(), DEFAULT_LADDER, EngineMetrics(), time.monotonic)
    threads = engine._makers
    assert isinstance(threads, RenderThreads)
    link = EdgeLink(PipeServer(engine, lambda *_: None, ARENA_BYTES), Arena(ARENA_BYTES), 0)
    edge = Edge()
    link.connection_made(edge)
    link.data_received(messages.pack_number(Kind.OPEN, 0))
    for number in range(viewers):
        link.data_received(messages.pack_hello(number, Client(f"address {number}", f"session {number}")))
    request = RenderRequest.at("scene", VIEW, LENS, profile=2)
    taking: list[float] = []
    making: list[float] = []
    answering: list[float] = []
    for burst in range(BURSTS):
        now = time.monotonic()
        asked = [messages.pack_request(n, (burst * BURST + n) % viewers, now, now, request) for n in range(BURST)]
        began = time.perf_counter()
        link.data_received(b"".join(asked))
        taken = time.perf_counter()
        for _ in range(BURST):
            threads.make_next()
        made = time.perf_counter()
        engine._answers.deliver()
        link._flush()
        answered = time.perf_counter()
        for each, seconds in ((taking, taken - began), (making, made - taken), (answering, answered - made)):
            each.append(1e6 * seconds / BURST)
        for _, content in Splitter().feed(edge.sent):
            frame = messages.unpack_frame(content, is_inline=False)
            link.data_received(messages.pack_offset(Kind.RELEASE, frame.offset))
        edge.sent = b""
    print(
        f"µs a request, {viewers} viewers of an address each: taking it {min(taking):.1f}, making its frame "
        f"{min(making):.1f}, answering {min(answering):.1f}"
    )


async def ask(path: Path, viewers: int, addresses: int, seconds: float) -> None:
    """Ask as an edge with so many viewers does."""
    outcomes: Counter[bool] = Counter()
    times: list[float] = []

    def receiver(asked: float) -> Callable[[Frame | Exception], None]:
        def receive(answer: Frame | Exception) -> None:
            outcomes[isinstance(answer, Frame)] += 1
            if isinstance(answer, Frame):
                answer.release()
                times.append(time.monotonic() - asked)

        return receive

    async with PipeClient(path, 0, lambda *_: None) as edge:
        await edge.connected()
        clients = [Client(f"address {n % addresses}", f"session {n}") for n in range(viewers)]
        request = RenderRequest.at("scene", VIEW, LENS, profile=2)
        began, asked = time.monotonic(), 0
        while (now := time.monotonic()) < began + seconds:
            while asked < (now - began) * viewers * FRAMES_PER_S:
                edge.request(clients[asked % viewers], request, now, receiver(now))
                asked += 1
            await asyncio.sleep(0.001)
        async with asyncio.timeout(20):
            while outcomes.total() < asked:  # noqa: ASYNC110 - the last ones
                await asyncio.sleep(0.01)
    times.sort()
    print(outcomes[True], 1000 * times[len(times) * 95 // 100], outcomes[False])


def main() -> None:
    """Measure with all viewers behind one address, and with an address each."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--viewers", type=int, default=72)
    parser.add_argument("--addresses", type=int)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--edge", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--threads", action="store_true", help="as a rasteriser without lanes")
    parser.add_argument("--one-thread", action="store_true")
    options = parser.parse_args()
    if options.one_thread:
        asyncio.run(measure_one_thread(options.viewers))
        return
    if options.edge is not None:
        uvloop.run(ask(options.edge, options.viewers, options.addresses, options.seconds))
        return
    rasterizer = Instant() if options.threads else InstantRasterizer(FRAME_BYTES)
    for addresses in (1, options.viewers) if options.addresses is None else (options.addresses,):
        uvloop.run(measure(rasterizer, options.viewers, addresses, options.seconds))


if __name__ == "__main__":
    main()
