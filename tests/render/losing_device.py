"""The `tigas` command on a machine whose GPU fails for good as soon as it is used. Run by `test_cli.py`."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

from tests.render.fakes import FakeRasterizer
from tigas_common import cli
from tigas_common.errors import DeviceLost
from tigas_render.raster.base import Rasterizer

REASON = "cuda:0 failed (an illegal memory access); restart the service."


def create_rasterizer(device: str, cache: Path) -> Rasterizer:
    return FakeRasterizer(device="cuda:0", error=DeviceLost(REASON))


if __name__ == "__main__":
    with patch("tigas_render.main.create_rasterizer", create_rasterizer):
        cli.main()
