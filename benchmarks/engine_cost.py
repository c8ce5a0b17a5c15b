"""What a frame costs the engine's process in Python: a rasteriser that takes no time, and an edge behind the pipe.

python -m benchmarks.engine_cost [--viewers 72] [--seconds 10]
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
from tigas_render.gaussians import Gaussians
from tigas_render.main import SWITCH_S
from tigas_render.metrics import EngineMetrics
from tigas_render.pipe.client import PipeClient
from tigas_render.pipe.server import serve_edges
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer

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
    """Has as many frames in flight as the CUDA rasteriser."""

    device = "instant"
    frames_in_flight = 6
    image = Picture(bytes(FRAME_BYTES))

    def prepare(self, gaussians: Gaussians) -> PreparedScene:
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


async def measure(viewers: int, addresses: int, seconds: float) -> None:
    """Serve an edge in a process of its own and tell what each of its frames costs here."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pipe"
        async with (
            Engine(Instant(), Scene(), DEFAULT_LADDER, EngineMetrics(), time.monotonic) as engine,
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
        f"{user + system:.0f} µs a frame ({user:.0f} user, {system:.0f} system; {of_loop * 1e6 / frames:.0f} on the event "
        f"loop's thread), {switches:.1f} switches, "
        f"p95 {late:.1f} ms"
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
    options = parser.parse_args()
    if options.edge is not None:
        uvloop.run(ask(options.edge, options.viewers, options.addresses, options.seconds))
        return
    for addresses in (1, options.viewers) if options.addresses is None else (options.addresses,):
        uvloop.run(measure(options.viewers, addresses, options.seconds))


if __name__ == "__main__":
    main()
