"""What becomes of frames when the GPU is full or fails, on stand-ins for the GPU and CUDA's packages."""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

import pytest
import torch

from tests.render.raster.views import camera
from tigas_common.errors import DeviceLost, OutOfDeviceMemory
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
        rasterizer._device, rasterizer._full = torch.device("cpu"), False
        rasterizer._make_current = lambda: None
        yield rasterizer


@pytest.fixture(autouse=True)
def cuda(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """Stands for what PyTorch asks of the driver."""
    driver = MagicMock()
    for name in ("current_stream", "empty_cache", "synchronize"):
        monkeypatch.setattr(torch.cuda, name, getattr(driver, name))
    return driver


def workspace_with_room(entries: int, needed: int) -> Any:
    """A workspace whose last frame needed more entries than there is room for."""
    workspace = object.__new__(import_module("tigas_render.raster.cuda.workspace").Workspace)
    workspace._device = torch.device("cpu")
    workspace._buffers = {name: torch.empty(0, dtype=torch.uint8) for name in ("frame", "progress")}
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


def render(rasterizer: Any) -> Any:
    """A view of a scene that nobody looks into."""
    scene = object.__new__(import_module("tigas_render.raster.cuda.scene").CudaScene)
    return rasterizer.render(scene, camera(64, 48), "png")


def test_once_memory_was_short_the_next_frame_finds_what_idle_workspaces_kept(rasterizer: Any, cuda: MagicMock) -> None:
    idle, busy = workspace_with_room(1000, 10), workspace_with_room(1000, 10)
    rasterizer._free = [idle, busy]
    busy.start.side_effect = torch.cuda.OutOfMemoryError("full")
    with pytest.raises(OutOfDeviceMemory):
        render(rasterizer)
    assert idle.nbytes == 8000
    cuda.empty_cache.assert_not_called()  # the engine unloads a scene first
    busy.start.side_effect = lambda *_: cuda.empty_cache.assert_called_once()
    render(rasterizer).close()
    assert idle.nbytes == busy.nbytes == 0
    render(rasterizer).close()
    cuda.empty_cache.assert_called_once()


@pytest.mark.parametrize("works", [True, False], ids=["the GPU works", "the GPU is lost"])
@pytest.mark.parametrize(
    ("message", "full"),
    [
        ("CUDA error: out of memory\nCompile with TORCH_USE_CUDA_DSA", True),
        ("CUDA_ERROR_OUT_OF_MEMORY: The API call failed", True),
        ("nvjpegEncodeYUV failed with status 2", False),
    ],
)
def test_one_failure_costs_one_request_while_the_gpu_works(
    rasterizer: Any, cuda: MagicMock, message: str, full: bool, works: bool
) -> None:
    cuda.synchronize.side_effect = None if works else RuntimeError("CUDA error: an illegal memory access")
    workspace = workspace_with_room(1000, 10)
    workspace.start.side_effect = RuntimeError(message)
    rasterizer._free = [workspace]
    expected = OutOfDeviceMemory if full else RuntimeError if works else DeviceLost
    with pytest.raises(expected) as raised:
        render(rasterizer)
    assert type(raised.value) is expected
    assert rasterizer._free == [workspace]


def test_a_gpu_that_cannot_be_opened_is_one_sentence(
    rasterizer: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def full(device: torch.device) -> tuple[int, int]:
        raise RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be reported later")

    monkeypatch.setattr(torch.cuda, "get_device_capability", full)
    with pytest.raises(ValueError, match=r"^cuda:0 cannot be used: CUDA error: out of memory\.$"):
        type(rasterizer)(0, tmp_path)
