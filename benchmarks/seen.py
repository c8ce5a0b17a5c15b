"""Error of pictures that are both blurred and late: how the errors of a rung and of a frame's age combine.

    python -m benchmarks.seen MOVEMENT.csv … [--moments 6]

At moments of recorded movements in the courtyard, frames of rungs that are 20 to 1000 ms old are shown at 640×360 in
three ways (as they came, turned, turned and moved by depth), and compared with the view of the moment. Movements are in
metres, as written by `tigas movement import --anchor start --settings …`. The errors of the same frames when fresh, and
of lossless frames when late, are combined as norms of several degrees. The tables show the root mean square of the
difference from the measured error, in dB of PSNR and of SSIM.
"""

from __future__ import annotations

import argparse
import io
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch.nn.functional import grid_sample

from benchmarks.views import centred_lens, start_view
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.movement.trace import MovementTrace, placed
from tigas_experiments.quality.picture import Picture, compare
from tigas_render.encode.images import encode_jpeg
from tigas_render.raster.base import Camera
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.demo import DEMO_SOURCE

Floats = NDArray[np.float64]
Errors = tuple[float, float]
"""Mean squared error of 8-bit RGB, and 1 less SSIM."""
LENS = centred_lens(640, 360)
WIDE = LENS.widened(96, 54)
"""With an overscan of 15 %."""
RUNGS = ((560, 315, 85), (416, 234, 60), (240, 136, 50), (176, 99, 25), (128, 72, 25), (128, 72, 10))
"""Width, height and quality: rungs 1, 3, 5, 7, 8 and 9 of the courtyard's ladder for a display of this size."""
HORIZONS_MS = (20, 50, 100, 200, 400, 1000)
WAYS = ("stale", "rotation", "depth")
DEGREES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
IN_SIGHT = 0.1
"""Moments at which a smaller share of the view differs from the background are left out."""


class Courtyard:
    def __init__(self) -> None:
        gaussians = DEMO_SOURCE.load()
        view = start_view(gaussians, builtin=True)
        (x, y, z), (a, b, c), (i, j, k) = view["position"], view["look_at"], view["up"]
        self.background = DEMO_SOURCE.metadata.background
        self.info = SceneInfo(
            id="courtyard", name="Courtyard", state="loaded", error=None, gaussians=None, sh_degree=None, file_bytes=0,
            memory_bytes=0, preview="", up=(i, j, k), background=self.background,
            camera=StartCamera(position=(x, y, z), look_at=(a, b, c)),
        )  # fmt: skip
        self._rasterizer = CpuRasterizer()
        self._scene = self._rasterizer.prepare(gaussians)

    def render(self, pose: Pose, lens: Intrinsics, scale: float = 1.0) -> tuple[Picture, Floats]:
        """A picture and its inverse depth."""
        with self._rasterizer.render(self._scene, Camera(pose, lens, self.background, scale), depth=True) as image:
            return image.to_host().copy(), np.asarray(image.depth, np.float64)

    def rung(self, pose: Pose, width: int, height: int, quality: int) -> Picture:
        """A frame of a rung, enlarged to the pixels of WIDE."""
        scale = width / LENS.width
        frame, _ = self.render(pose, WIDE.resized(round(WIDE.width * scale), round(WIDE.height * scale)), 1 / scale)
        with Image.open(io.BytesIO(encode_jpeg(frame, quality))) as image:
            return np.asarray(image.convert("RGB").resize((WIDE.width, WIDE.height), Image.Resampling.BICUBIC))


def sources(frame: Pose, view: Pose, depth: Floats | None) -> Floats:
    """Position in the frame of each pixel of the view, for grid_sample; without depth, all is infinitely far.

    A point of inverse depth d along a ray u of the view, whose camera is at t in the frame's axes, is t + s·u with
    s = (1/d − t_z) / u_z; d is found by fixed-point iteration.
    """
    to_frame = np.array(frame.rotation).T
    columns, rows = np.meshgrid(np.arange(LENS.width) + 0.5, np.arange(LENS.height) + 0.5)
    rays = np.stack([(columns - LENS.cx) / LENS.fx, (rows - LENS.cy) / LENS.fy, np.ones_like(rows)], axis=-1)
    u = rays @ (to_frame @ np.array(view.rotation)).T
    t = to_frame @ (np.array(view.position) - np.array(frame.position))

    def grid(points: Floats) -> Floats:
        z = np.where(points[..., 2] > 1e-6, points[..., 2], np.nan)
        x, y = WIDE.fx * points[..., 0] / z + WIDE.cx, WIDE.fy * points[..., 1] / z + WIDE.cy
        found: Floats = np.nan_to_num(np.stack([x / WIDE.width, y / WIDE.height], -1) * 2 - 1, nan=-1).clip(-4, 4)
        return found

    found = grid(u)
    d = np.zeros(u.shape[:2])
    for _ in range(0 if depth is None else 8):
        d += 0.7 * (_sampled(np.asarray(depth)[..., None], found, "bilinear")[..., 0] - d)
        found = grid(t * d[..., None] + ((1 - t[2] * d) / np.where(u[..., 2] > 1e-6, u[..., 2], np.nan))[..., None] * u)
    return found


def _sampled(values: Floats, grid: Floats, mode: str) -> Floats:
    tensor = torch.from_numpy(values).permute(2, 0, 1)[None]
    found = grid_sample(tensor, torch.from_numpy(grid)[None], mode, "border", align_corners=False)
    result: Floats = found[0].permute(1, 2, 0).numpy()
    return result


def shown(picture: Picture, grid: Floats | None) -> Picture:
    """A picture of WIDE as a viewer with LENS sees it."""
    if grid is None:
        x, y = (WIDE.width - LENS.width) // 2, (WIDE.height - LENS.height) // 2
        return picture[y : y + LENS.height, x : x + LENS.width]
    return _sampled(picture.astype(np.float64), grid, "bicubic").round().clip(0, 255).astype(np.uint8)


def errors(picture: Picture, truth: Picture) -> Errors:
    return float(np.mean(np.square(picture.astype(np.float64) - truth))), 1 - compare(picture, truth).ssim


def samples(scene: Courtyard, walk: MovementTrace, at: float) -> Iterator[tuple[str, Errors, Errors, Errors]]:
    """Of one moment: the way, the errors of a fresh frame of a rung, of a lossless late one, and of a late one."""

    def pose(time: float) -> Pose:
        (x, y, z), quaternion = (each[0].tolist() for each in walk.poses_at([time]))
        return Pose.from_quaternion((x, y, z), tuple(quaternion))

    now = pose(at)
    truth, _ = scene.render(now, LENS)
    if (np.abs(truth - np.array(scene.background) * 255).max(axis=-1) > 8).mean() < IN_SIGHT:
        return
    for horizon in HORIZONS_MS:
        was = pose(at - horizon)
        lossless, depth = scene.render(was, WIDE)
        rungs = [scene.rung(was, *rung) for rung in RUNGS]
        fresh = [errors(shown(rung, None), shown(lossless, None)) for rung in rungs]
        grids = {"stale": None, "rotation": sources(was, now, None), "depth": sources(was, now, depth)}
        for way, grid in grids.items():
            late = errors(shown(lossless, grid), truth)
            for own, rung in zip(fresh, rungs, strict=True):
                yield way, own, late, errors(shown(rung, grid), truth)


def table(
    title: str, found: list[tuple[str, Errors, Errors, Errors]], off: Callable[[Floats, Floats], Floats]
) -> Table:
    """Root mean square of a difference, for each way and degree of the norm."""
    result = Table(title=title)
    for heading in ("way", *(f"degree {degree:g}" for degree in DEGREES)):
        result.add_column(heading, justify="right")
    for way in (*WAYS, "all"):
        own = np.array([values for name, *values in found if way in (name, "all")])  # [N, rung/late/both, mse/ssim]
        cells = []
        for degree in DEGREES:
            combined = (own[:, 0] ** degree + own[:, 1] ** degree) ** (1 / degree)
            cells.append(f"{np.sqrt(np.mean(np.square(off(combined, own[:, 2])))):.3f}")
        result.add_row(way, *cells)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("movements", nargs="+", type=Path, metavar="MOVEMENT.csv")
    parser.add_argument("--moments", type=int, default=6, help="of each movement, one at random in each equal part")
    options = parser.parse_args()
    scene = Courtyard()
    moments = []
    for path in options.movements:
        points = placed(MovementTrace.read(path), scene.info)
        times, positions, quaternions = (
            np.array([point[key] for point in points]) for key in ("t_ms", "position", "quaternion")
        )
        walk = MovementTrace(times, positions, quaternions, "scene", "scene")
        edges = np.linspace(HORIZONS_MS[-1], walk.duration_ms, options.moments + 1)
        chance = np.random.default_rng(zlib.crc32(path.stem.encode()))
        moments += [(walk, at) for at in chance.uniform(edges[:-1], edges[1:]).tolist()]
    found = [sample for walk, at in track(moments) for sample in samples(scene, walk, at)]
    console = Console()
    console.print(f"{len(found)} pictures")
    console.print(table("PSNR, dB", found, lambda ours, theirs: 10 * np.log10(ours[:, 0] / theirs[:, 0])))
    console.print(table("SSIM", found, lambda ours, theirs: ours[:, 1] - theirs[:, 1]))


if __name__ == "__main__":
    main()
