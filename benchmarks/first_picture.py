"""Time to the first picture of a large scene, and frames of another scene's viewer while it loads.

    python -m benchmarks.first_picture SCENE [--rounds 3] [--device cpu]

Each round starts a service. The viewer of the built-in scene requests its next frame when it has the last, first for
some seconds alone, then while the large scene loads: before anything of it was kept, and after.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
import time
from pathlib import Path
from statistics import quantiles

import httpx

from benchmarks.load.server import started
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import RenderRequest, SceneInfo

ALONE_S = 5.0
UNHURRIED_S = 300.0
LENS = Intrinsics(500, 500, 320, 180, 640, 360)


def view(scene: SceneInfo, turn: float = 0.0, *, coarse: bool = False) -> str:
    """A request from a scene's start camera, turned by some degrees."""
    assert scene.camera is not None
    x, y, z = scene.camera.look_at
    pose = Pose.look_at(scene.camera.position, (x + turn / 100, y, z), scene.up)
    return RenderRequest.at(scene.id, pose, LENS, profile=2, coarse=coarse).model_dump_json(exclude_none=True)


async def load(http: httpx.AsyncClient, path: str) -> SceneInfo:
    return SceneInfo.model_validate_json((await http.post(path)).raise_for_status().content)


class Viewer:
    """Of the built-in scene, until it is cancelled."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self._http = http
        self.taken: list[float] = []
        """Milliseconds of each frame."""

    async def watch(self) -> None:
        scene = await load(self._http, "/scenes/courtyard/load")
        turn = 0.0
        while True:
            began, turn = time.monotonic(), turn + 1
            headers = {"Tigas-Viewer": "another"}
            answer = await self._http.post("/render", content=view(scene, turn % 90), headers=headers)
            answer.raise_for_status()
            self.taken.append(1000 * (time.monotonic() - began))

    def report(self, name: str, seconds: float) -> str:
        """Frame rate and latency since the last report."""
        taken, self.taken = self.taken, []
        cuts = quantiles(taken, n=100)
        latencies = ", ".join(f"p{each} {cuts[each - 1]:.0f}" for each in (50, 95, 99))
        return f"{name}: {len(taken) / seconds:5.1f} frames/s, {latencies} ms"


async def measure(url: str, id: str) -> None:
    async with httpx.AsyncClient(base_url=url, trust_env=False, timeout=UNHURRIED_S) as http:
        viewer = Viewer(http)
        watching = asyncio.create_task(viewer.watch())
        await asyncio.sleep(2)
        viewer.taken.clear()
        await asyncio.sleep(ALONE_S)
        print(viewer.report("  other viewer, alone", ALONE_S))
        began = time.monotonic()
        scene = await load(http, f"/scenes/{id}/load?coarse=1")
        frame = await http.post("/render", content=view(scene, coarse=True))
        first = time.monotonic() - began
        about = "coarse" if "coarse=1" in frame.headers["tigas-frame"] else "whole"
        scene = await load(http, f"/scenes/{id}/load")
        (await http.post("/render", content=view(scene))).raise_for_status()
        whole = time.monotonic() - began
        print(viewer.report("  other viewer, while it loads", whole))
        print(f"  first picture after {first:.2f} s ({about}), of the whole scene after {whole:.1f} s", flush=True)
        watching.cancel()


def main(scene: Path, rounds: int, device: str) -> None:
    with tempfile.TemporaryDirectory(prefix="tigas-first-") as name:
        models = Path(name) / "models"
        models.mkdir()
        place = models / f"large{scene.suffix}"
        place.symlink_to(scene.resolve(), target_is_directory=scene.is_dir())
        cache = Path(name) / "cache"
        os.environ["TIGAS_RENDER_CACHE"] = str(cache)
        for round in range(rounds):
            for kept in (False, True):
                for path in () if kept else (*cache.glob("start-view-*"), *cache.glob("coarse-*")):
                    path.unlink()
                print(f"round {round + 1}, {'loaded before' if kept else 'never loaded'}")
                options = ("--scenes", str(models), "--device", device, "--edges", "1", "--memory-gb", "16")
                with started("service", options) as server:
                    asyncio.run(measure(server.url, "large"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path, help="file or folder of a large scene, as `tigas scene grid` makes it")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    main(arguments.scene, arguments.rounds, arguments.device)
