"""The `tigas` command on a machine with a GPU that fails for good, or hangs, on first use. Run by `test_cli.py`."""

from __future__ import annotations

import sys
from pathlib import Path
from unittest.mock import patch

from tests.render.fakes import FakeRasterizer
from tigas_common import cli
from tigas_common.errors import DeviceLost
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, Rasterizer

REASON = "cuda:0 failed (an illegal memory access); restart the service."


class StuckRasterizer(FakeRasterizer):
    """Never returns from a frame."""

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: str = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> Image:
        self.gate.wait()
        raise AssertionError


def create_lost(device: str, cache: Path) -> Rasterizer:
    return FakeRasterizer(device="cuda:0", error=DeviceLost(REASON))


def create_stuck(device: str, cache: Path) -> Rasterizer:
    return StuckRasterizer(device="cuda:0")


if __name__ == "__main__":
    create = {"lost": create_lost, "stuck": create_stuck}
    with (
        patch("tigas_render.server.main.create_rasterizer", create[sys.argv.pop(1)]),
        patch("tigas_render.engine.engine.STUCK_S", 0.1),
        patch("tigas_render.server.service.HOUSEKEEPING_S", 0.1),
        patch("tigas_render.server.main.LOST_GRACE_S", 0.5),
    ):
        cli.main()
