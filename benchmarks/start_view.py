"""Derived start views: error of the up axis in tilted copies, coverage and middle distance of the picture, and time.

    python -m benchmarks.start_view [NAME=PLY …] [--pictures FOLDER]

Without a scene it takes the built-in courtyard, without its own camera. True is -y up before the tilt.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.views import chosen
from tigas_common.command import POSITIONAL, Command, Metavar, parse
from tigas_common.pose import Pose
from tigas_render.gaussians import Gaussians
from tigas_render.raster.cpu import CpuRasterizer
from tigas_render.scenes.source import DEFAULT_UP, SceneMetadata
from tigas_render.scenes.start_view.statistics import SceneStatistics
from tigas_render.server.preview import preview_camera

TILTS = (((1, 0, 0), 0), ((1, 0, 0.3), 10), ((0.3, 0, -1), 15), ((-1, 0.2, 0.5), 20), ((0.2, 0.1, 1), 25))
"""Axis and degrees."""
WIDTH, HEIGHT = 320, 180


class StartViews(Command):
    """Print a row for each scene and tilt."""

    scenes: Annotated[tuple[str, ...], POSITIONAL, Metavar("NAME=PLY")] = ()
    """Scenes; the courtyard unless given."""
    pictures: Path | None = None
    """Folder for the pictures, as PNG."""

    def run(self) -> None:
        table = Table("scene", "tilt, °", "error, °", "covered", "middle / focus", "CPU s", box=None)
        rasterizer = CpuRasterizer()
        for name, scene, _ in chosen(list(self.scenes), None):
            for axis, degrees in TILTS:
                gaussians, up = tilted(scene, axis, degrees)
                statistics = SceneStatistics.of(gaussians)
                began = time.process_time()
                view = statistics.view(SceneMetadata())
                spent = time.process_time() - began
                error = math.degrees(math.acos(min(1.0, float(np.dot(view.up, up)))))
                camera = preview_camera(view.camera, view.up, WIDTH, HEIGHT)
                prepared = rasterizer.prepare(gaussians)
                with rasterizer.render(prepared, camera, depth=True) as black:
                    dark = black.to_host().astype(int)
                    assert black.depth is not None
                    inverse = np.asarray(black.depth)
                    if self.pictures is not None:
                        self.pictures.mkdir(parents=True, exist_ok=True)
                        (self.pictures / f"{name}-{degrees}.png").write_bytes(black.encode("png", 100))
                with rasterizer.render(prepared, replace(camera, background=(1, 1, 1))) as white:
                    covered = float((white.to_host().astype(int) - dark < 13).mean())
                rows, columns = (slice(n // 2 - 2, n // 2 + 2) for n in inverse.shape)
                middle = 1 / max(float(inverse[rows, columns].max()), 1e-9)
                ratio = middle / math.dist(view.camera.position, view.camera.look_at)
                table.add_row(name, str(degrees), f"{error:.1f}", f"{covered:.2f}", f"{ratio:.2f}", f"{spent:.2f}")
        Console().print(table)


def tilted(scene: Gaussians, axis: tuple[float, float, float], degrees: float) -> tuple[Gaussians, list[float]]:
    """A scene turned about an axis, and where its -y points then. SH coefficients are not turned."""
    half = math.radians(degrees) / 2
    x, y, z = (float(part) for part in np.array(axis) / np.linalg.norm(axis) * math.sin(half))
    w = math.cos(half)
    turn = np.array(Pose.from_quaternion((0, 0, 0), (x, y, z, w)).rotation)
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    means, quaternions = (scene.means @ turn.T).astype(np.float32), (scene.quaternions @ product.T).astype(np.float32)
    return replace(scene, means=means, quaternions=quaternions), (turn @ DEFAULT_UP).tolist()


if __name__ == "__main__":
    parse(StartViews, "benchmarks.start_view", sys.argv[1:]).run()
