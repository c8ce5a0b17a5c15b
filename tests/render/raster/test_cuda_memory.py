"""What becomes of a frame whose lists cannot grow, on stand-ins for the GPU and CUDA's packages."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from typing import Any
from unittest.mock import MagicMock, patch

import pytest
import torch

from tests.render.raster.views import camera
from tigas_common.errors import OutOfDeviceMemory
from tigas_render.raster.devices import why_no_cuda

pytestmark = pytest.mark.skipif(why_no_cuda() is None, reason="CUDA's own packages are here")

PACKAGES = (
    "cuda", "cuda.bindings", "cuda.core", "cuda.core.graph", "cuda.core._utils", "cuda.core._utils.cuda_utils",
    "cuda.pathfinder",
)  # fmt: skip


@pytest.fixture
def rasterizer() -> Iterator[Any]:
    """A CudaRasterizer that was never told of a device."""
    packages = {name: MagicMock() for name in PACKAGES}
    packages["cuda.core._utils.cuda_utils"].CUDAError = type("CUDAError", (Exception,), {})
    with patch.dict(sys.modules, packages):
        module = import_module("tigas_render.raster.cuda.rasterizer")
        rasterizer = object.__new__(module.CudaRasterizer)
        rasterizer.device, rasterizer._free, rasterizer._lock = "cuda:0", [], threading.Lock()
        rasterizer._make_current = lambda: None
        yield rasterizer


def workspace_with_room(entries: int, needed: int) -> Any:
    """A workspace whose last frame needed more entries than there is room for."""
    workspace = object.__new__(import_module("tigas_render.raster.cuda.workspace").Workspace)
    workspace._device, workspace._buffers = torch.device("cpu"), {}
    workspace._needed = ctypes.c_uint32(needed)
    workspace.stream, workspace.start, workspace.copy_pixels = MagicMock(), MagicMock(), MagicMock()
    workspace._allocate("entries", 8 * entries)
    return workspace


def test_lists_that_cannot_grow_are_an_error_and_their_workspace_is_used_again(
    rasterizer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = torch.empty

    def full(size: int, **options: Any) -> torch.Tensor:
        if size > 0:
            raise torch.cuda.OutOfMemoryError("full")
        return empty(size, **options)

    workspace = workspace_with_room(1000, needed=5000)
    image = import_module("tigas_render.raster.cuda.rasterizer").CudaImage(
        rasterizer, workspace, MagicMock(), camera(64, 48), "png"
    )
    with monkeypatch.context() as patched:
        patched.setattr(torch, "empty", full)
        with pytest.raises(OutOfDeviceMemory), image:
            image.encode("png", 0)
    assert rasterizer._free == [workspace]
    assert workspace.nbytes == 0
    assert not workspace.finish(), "the frame has to be drawn again"
    assert workspace.nbytes >= 8 * 5000
    assert workspace.finish()
