"""What a late frame looks like once it is turned to where the viewer looks by now, against what should be seen.

    python -m benchmarks.reprojection walk.csv [more.csv …] [--scene NAME=PLY …] [--cameras cameras.json]
        [--predicted poses.csv] [--depths] [--out samples.csv]

For moments all over recorded movements (docs/movement.md), placed into each scene as experiments place them: the frame
of the pose 20 to 300 ms before, 640×360 and without JPEG, is shown in several ways, and compared with the view of the
moment itself by PSNR and SSIM.

    stale      as it came
    rotation   turned; everything counts as infinitely far
    sphere     turned and moved; everything counts as far as the scene's subject
    depth      turned and moved by the coarse depth that frames can carry
    predicted  the same of a frame that was asked for where the viewer was expected to be (--predicted)

The border is the share of the view that lies outside the frame with its margins; it is filled with the frame's edge.
Moments at which next to nothing of the scene is in sight are left out. Means over moments; PSNR of equal pictures
counts as 60 dB. At the end: how squared error grows with how far the view has turned since the frame's pose, which a
controller needs to know (`fitted`). `--depths` compares kinds of depth instead.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.reprojection_depth import PAINTED, DepthScene, packed
from benchmarks.reprojection_warp import Frame, cropped, turned, with_margins
from benchmarks.views import View, centred_lens, chosen
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import SceneInfo, StartCamera
from tigas_experiments.movement.placing import placed
from tigas_experiments.movement.trace import MovementTrace
from tigas_experiments.quality.picture import Picture, compare
from tigas_render.gaussians import Gaussians
from tigas_render.raster.base import Camera, Depth
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.demo import DEMO_METADATA

TURN_DEG = 4.0
IN_SIGHT = 0.1
"""Moments at which less of the view than this differs from the background say nothing."""
HORIZONS_MS = (20, 50, 100, 200, 300)
MAX_PSNR_DB = 60.0
AS_SENT, NOT_PACKED = "as sent", "not packed"
WAYS = ("stale", "rotation", "sphere", "depth", "predicted")
Floats = NDArray[np.float64]
Predicted = dict[tuple[str, int, int], tuple[Floats, Floats]]
"""Position and quaternion in the movement's own frame, by movement, moment and horizon in ms."""


@dataclasses.dataclass(frozen=True, slots=True)
class Sample:
    """One way to show one late frame."""

    scene: str
    movement: str
    at_ms: int
    horizon_ms: int
    way: str
    turn_deg: float
    """Between the frame's pose and the view's."""
    shift: float
    """The same, as a share of the distance to the scene's subject."""
    mse: float
    """Of 8-bit RGB."""
    psnr_db: float
    ssim: float
    border: float
    bytes: int = 0
    """Of the depth."""


@dataclasses.dataclass(frozen=True, slots=True)
class Walk:
    """A movement in a scene."""

    name: str
    moved: MovementTrace

    def pose(self, at_ms: float) -> Pose:
        """Where the viewer is."""
        return _pose(*(each[0] for each in self.moved.poses_at([at_ms])))

    def moments(self, count: int, longest: float = HORIZONS_MS[-1]) -> Floats:
        """One at random in each of equal parts, from when the longest horizon is past."""
        rng = np.random.default_rng(zlib.crc32(self.name.encode()))
        edges = np.linspace(longest, self.moved.duration_ms, count + 1)
        found: Floats = np.round(rng.uniform(edges[:-1], edges[1:]))
        return found


class Bench:
    """One scene."""

    def __init__(self, name: str, gaussians: Gaussians, view: View, overscan: float, lens: Intrinsics) -> None:
        self.name = name
        self.info = scene_info(name, view)
        self.subject = math.dist(view["position"], view["look_at"])
        self._background = DEMO_METADATA.background if name == "courtyard" else (0.0, 0.0, 0.0)
        self._rasterizer = CpuRasterizer()
        self._scene = self._rasterizer.prepare(gaussians)
        self._depth = DepthScene(self._rasterizer, gaussians)
        self._lens, self._wide = lens, with_margins(lens, overscan)

    def samples(
        self, walk: Walk, at: float, predicted: Predicted, horizons: Sequence[int] = HORIZONS_MS
    ) -> Iterator[Sample]:
        """One moment, at all horizons, in all ways."""
        pose = walk.pose(at)
        truth = self._rendered(pose, self._lens)
        if not self._in_sight(truth):
            return
        for horizon in horizons:
            frame, depth = self._frame(walk.pose(at - horizon))
            inverse, sent = packed(depth)
            ways: dict[str, tuple[Picture, float]] = {
                "stale": (cropped(frame, self._lens), 0.0),
                "rotation": turned(frame, pose, self._lens, 0.0),
                "sphere": turned(frame, pose, self._lens, 1 / self.subject),
                "depth": turned(frame, pose, self._lens, inverse),
            }
            expected = predicted.get((walk.name, int(at), horizon))
            if expected is not None:
                ahead, depth = self._frame(self._placed(*expected))
                inverse, _ = packed(depth)
                ways["predicted"] = turned(ahead, pose, self._lens, inverse)
            for way, (picture, border) in ways.items():
                yield self._sample(walk, at, horizon, way, frame.pose, pose, picture, truth, border, sent)

    def depths(self, walk: Walk, at: float) -> Iterator[Sample]:
        """One moment with every kind of depth."""
        pose = walk.pose(at)
        truth = self._rendered(pose, self._lens)
        if not self._in_sight(truth):
            return
        for horizon in HORIZONS_MS[1:]:
            frame, depth = self._frame(walk.pose(at - horizon))
            kinds = {AS_SENT: packed(depth), NOT_PACKED: (depth.astype(np.float64), 0)}
            kinds |= {kind.name: self._depth.inverse(frame.pose, frame.lens, kind) for kind in PAINTED}
            for name, (inverse, sent) in kinds.items():
                picture, border = turned(frame, pose, self._lens, inverse)
                yield self._sample(walk, at, horizon, name, frame.pose, pose, picture, truth, border, sent)

    def _in_sight(self, truth: Picture) -> bool:
        background = np.round(np.array(self._background) * 255)
        return bool((np.abs(truth - background).max(axis=-1) > 8).mean() >= IN_SIGHT)

    def _frame(self, pose: Pose) -> tuple[Frame, Depth]:
        """With the depth that the render service would send."""
        camera = Camera(pose, self._wide, self._background)
        with self._rasterizer.render(self._scene, camera, depth=True) as image:
            assert image.depth is not None
            return Frame(image.to_host().copy(), pose, self._wide), image.depth

    def _rendered(self, pose: Pose, lens: Intrinsics) -> Picture:
        with self._rasterizer.render(self._scene, Camera(pose, lens, self._background)) as image:
            return image.to_host().copy()

    def _placed(self, position: Floats, quaternion: Floats) -> Pose:
        """A pose of a movement from the start camera, in the scene."""
        trace = MovementTrace(np.zeros(1), position[None], quaternion[None], "start", "m")
        point = placed(trace, self.info)[0]
        return _pose(np.array(point["position"]), np.array(point["quaternion"]))

    def _sample(
        self, walk: Walk, at: float, horizon: int, way: str, was: Pose, now: Pose, picture: Picture, truth: Picture,
        border: float, sent: int,
    ) -> Sample:  # fmt: skip
        quality = compare(picture, truth)
        turn = Rotation.from_matrix(np.array(was.rotation).T @ np.array(now.rotation)).magnitude()
        return Sample(
            self.name, walk.name, int(at), horizon, way, math.degrees(turn),
            math.dist(was.position, now.position) / self.subject,
            float(np.mean(np.square(picture.astype(np.float64) - truth))),
            min(quality.psnr_db, MAX_PSNR_DB), quality.ssim, border, sent,
        )  # fmt: skip


def walked(path: Path, info: SceneInfo) -> Walk:
    """A movement's file, placed in a scene."""
    points = placed(MovementTrace.read(path), info)
    times, positions, quaternions = (
        np.array([point[key] for point in points]) for key in ("t_ms", "position", "quaternion")
    )
    return Walk(path.stem, MovementTrace(times, positions, quaternions, "scene", "scene"))


def fitted(samples: list[Sample]) -> tuple[float, float]:
    """How squared error grows with how far the view has turned since the frame's pose: error at TURN_DEG, and power.

    A power law, by least squares of the root of the error over all moments, so that large errors do not decide alone.
    People walk while they turn, so the way they went is in it, and so is the border.
    """
    turns = np.array([max(one.turn_deg, 0.05) / TURN_DEG for one in samples])
    roots = np.sqrt([one.mse for one in samples])

    def off(law: Floats) -> Floats:
        result: Floats = np.exp(law[0] / 2) * turns ** (law[1] / 2) - roots
        return result

    log_error, power = least_squares(off, x0=(math.log(np.mean(roots**2) + 1e-3), 1.0), bounds=([-9, 0], [12, 4])).x
    return math.exp(log_error), float(power)


def main(
    movements: Annotated[list[Path], typer.Argument(metavar="MOVEMENT…")],
    scene: Annotated[list[str] | None, typer.Option(metavar="NAME=PLY", help="Without: the courtyard.")] = None,
    cameras: Annotated[Path | None, typer.Option(help="JSON with a start camera for each scene.")] = None,
    overscan: Annotated[float, typer.Option(min=0, max=0.5, help="Of the width or height, at each side.")] = 0.15,
    moments: Annotated[int, typer.Option(help="Of each movement in each scene.")] = 10,
    size: Annotated[str, typer.Option(help="Of frame and view.")] = "640x360",
    predicted: Annotated[Path | None, typer.Option(help="CSV: movement, t_ms, horizon_ms, x, y, z, qx … qw.")] = None,
    depths: Annotated[bool, typer.Option("--depths", help="Compare kinds of depth.")] = False,
    out: Annotated[Path | None, typer.Option(help="Every sample, as CSV.")] = None,
) -> None:
    """Print a table for each scene, one for all, and the fit."""
    width, height = map(int, size.split("x"))
    poses = read_predicted(predicted) if predicted else {}
    samples: list[Sample] = []
    for name, gaussians, view in chosen(scene, cameras):
        bench = Bench(name, gaussians, view, overscan, centred_lens(width, height))
        for path in movements:
            walk = walked(path, bench.info)
            for at in walk.moments(moments):
                samples += bench.depths(walk, at) if depths else bench.samples(walk, at, poses)
    if out is not None:
        write_samples(samples, out)
    ways = (
        [AS_SENT, NOT_PACKED, *(kind.name for kind in PAINTED)]
        if depths
        else [way for way in WAYS if any(one.way == way for one in samples)]
    )
    console = Console(width=150)
    if not samples:
        console.print("Nothing of the scene is in sight at any of these moments.")
        raise typer.Exit(1)
    scenes = list(dict.fromkeys(one.scene for one in samples))
    groups: list[str | None] = [*scenes, None] if len(scenes) > 1 else [*scenes]
    for group in groups:
        own = [one for one in samples if group in (None, one.scene)]
        console.print(_table(group or "all scenes", own, ways, depths=depths))
    if not depths:
        console.print(_fits(samples, groups, ways))


def _table(title: str, samples: list[Sample], ways: list[str], *, depths: bool) -> Table:
    table = Table(title=f"{title}: PSNR, dB (SSIM)", title_justify="left")
    horizons = sorted({one.horizon_ms for one in samples})
    for heading in ("", *(f"{horizon} ms" for horizon in horizons), *(["bytes"] if depths else [])):
        table.add_column(heading, justify="right")
    for way in ways:
        cells = []
        for horizon in horizons:
            own = [one for one in samples if (one.way, one.horizon_ms) == (way, horizon)]
            cells.append(f"{_mean(own, 'psnr_db'):.1f} ({_mean(own, 'ssim'):.3f})")
        sent = [f"{_mean([one for one in samples if one.way == way], 'bytes'):.0f}"] if depths else []
        table.add_row(way, *cells, *sent)
    if not depths:
        shown = [way for way in ("depth", "predicted") if way in ways]
        for way in shown:
            borders = [
                _mean([one for one in samples if (one.way, one.horizon_ms) == (way, horizon)], "border")
                for horizon in horizons
            ]
            table.add_row(f"border, {way}", *(f"{border:.2%}" for border in borders))
    return table


def _fits(samples: list[Sample], scenes: list[str | None], ways: list[str]) -> Table:
    horizons = sorted({one.horizon_ms for one in samples})
    table = Table(title=f"Squared error of 8-bit RGB: mean by age, and error · (turn / {TURN_DEG:g}°)^power")
    for heading in ("scene", "way", *(f"{horizon} ms" for horizon in horizons), "error", "power"):
        table.add_column(heading, justify="right")
    for scene in scenes:
        for way in ways:
            own = [one for one in samples if one.way == way and scene in (None, one.scene)]
            means = [_mean([one for one in own if one.horizon_ms == horizon], "mse") for horizon in horizons]
            error, power = fitted(own)
            cells = (*(f"{mean:.1f}" for mean in means), f"{error:.1f}", f"{power:.2f}")
            table.add_row(scene or "all scenes", way, *cells)
    return table


def _mean(samples: list[Sample], field: str) -> float:
    return float(np.mean([getattr(one, field) for one in samples])) if samples else math.nan


def read_predicted(path: Path) -> Predicted:
    """What `npm run predict-report -- --write` foretold."""
    with path.open(newline="") as file:
        return {
            (row["movement"], round(float(row["t_ms"])), round(float(row["horizon_ms"]))): (
                np.array([float(row[axis]) for axis in ("x", "y", "z")]),
                np.array([float(row[axis]) for axis in ("qx", "qy", "qz", "qw")]),
            )
            for row in csv.DictReader(file)
        }


def write_samples(samples: list[Sample], path: Path) -> None:
    """As CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(Sample)])
        writer.writeheader()
        writer.writerows(map(dataclasses.asdict, samples))


def _pose(position: Floats, quaternion: Floats) -> Pose:
    x, y, z = map(float, position)
    qx, qy, qz, qw = map(float, quaternion)
    return Pose.from_quaternion((x, y, z), (qx, qy, qz, qw))


def scene_info(name: str, view: View) -> SceneInfo:
    """As much of a scene as placing a movement asks for."""
    (x, y, z), (a, b, c), (i, j, k) = view["position"], view["look_at"], view["up"]
    camera = StartCamera(position=(x, y, z), look_at=(a, b, c))
    return SceneInfo(
        id=name, name=name, state="loaded", error=None, gaussians=None, sh_degree=None, file_bytes=0, memory_bytes=0,
        preview="", up=(i, j, k), camera=camera, background=(0, 0, 0),
    )  # fmt: skip


if __name__ == "__main__":
    typer.run(main)
