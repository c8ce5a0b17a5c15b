"""Does sampling cost the page frames? Its frame rate with and without, in the same page, turn by turn.

    python -m benchmarks.sampling [--pairs 8] [--seconds 5] [--stride 30]

A camera turns in a small scene, so that every frame of the display is another view, which the page asks for and shows.
The page's rate is that of the display's frames that it took part in. The goal: the median over all pairs of runs
differs with sampling by less than 2 %. New views a second are the renderer's doing, too, and are only told.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import statistics
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.web.scenes import SMALL, write_scenes
from tests.web.server import RenderServer
from tigas_common.wire.recording import Recording
from tigas_experiments.run.browser import Viewer, chromium

GOAL = 0.02
WIDTH, HEIGHT = 320, 180
ONE_RUNG = {"mode": "stateless", "controller": "fixed", "profile": 3, "refine": False}
SETTINGS = {**ONE_RUNG, "webp": False, "hud": False, "sidebar": False}


async def measured(viewer: Viewer, seconds: float, stride: int) -> tuple[float, float, int]:
    """Frames of the display and new views a second, and how many were sampled."""
    times = range(0, int(seconds * 1000) + 1, 50)
    points: list[dict[str, Any]] = [{"t_ms": t, **turned(t / 1000)} for t in times]
    await viewer.prepare(SETTINGS, turned(0))
    plan = {"points": points, "duration_ms": seconds * 1000, "capture_every_ms": 0, "sample_stride": stride}
    recording = await viewer.record(plan, seconds + 30)
    return (*rates(recording, seconds), len((await viewer.samples()).samples))


def turned(angle: float) -> dict[str, Any]:
    """The camera, turned by so many radians."""
    return {"position": [0, 0, 0], "quaternion": [0, math.sin(angle / 2), 0, math.cos(angle / 2)]}


def rates(recording: Recording, seconds: float) -> tuple[float, float]:
    """Frames of the display and new views, a second."""
    moved = {entry.pose for entry in recording.inputs if not entry.missed}
    shown = {frame.pose for frame in recording.frames if frame.pose in moved}
    return len(moved) / seconds, len(shown) / seconds


async def compare(url: str, pairs: int, seconds: float, stride: int) -> bool:
    """Print every pair and what they say together; whether the goal is met."""
    ratios: list[tuple[float, float]] = []
    async with chromium() as browser:
        page = await browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        await page.goto(f"{url}#/scene/{SMALL}")
        await page.wait_for_function("() => window.tigas !== undefined")
        viewer = Viewer(page)
        await measured(viewer, seconds, stride)  # everything is compiled and warm
        for pair in range(pairs):
            both = {}
            for chosen in (0, stride) if pair % 2 else (stride, 0):
                both[chosen] = await measured(viewer, seconds, chosen)
            (frames, views, _), (sampled_frames, sampled_views, samples) = both[0], both[stride]
            ratios.append((sampled_frames / frames - 1, sampled_views / views - 1))
            print(
                f"without {frames:5.1f} frames/s {views:5.1f} views/s   "
                f"with {sampled_frames:5.1f} frames/s {sampled_views:5.1f} views/s, {samples} samples"
            )
    frames = statistics.median(frames for frames, _ in ratios)
    views = statistics.median(views for _, views in ratios)
    print(f"with sampling: {frames:+.1%} frames of the display (goal: within {GOAL:.0%}), {views:+.1%} new views")
    return abs(frames) < GOAL


def main() -> None:
    """Exits with 1 if the goal is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--stride", type=int, default=30)
    options = parser.parse_args()
    with TemporaryDirectory() as models:
        write_scenes(Path(models))
        with RenderServer("--scenes", models) as server:
            sys.exit(not asyncio.run(compare(server.url, options.pairs, options.seconds, options.stride)))


if __name__ == "__main__":
    main()
