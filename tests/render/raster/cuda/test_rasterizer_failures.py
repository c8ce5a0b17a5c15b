"""Frames when the GPU is full or fails. The GPU is a fake: `fake_gpu`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import torch

from tests.render.raster.cuda.fake_gpu import FakeGpu, fake_gpu
from tests.render.raster.views import camera, cloud
from tigas_common.errors import DeviceLost, OutOfDeviceMemory, Overloaded
from tigas_common.wire.render import FrameFormat
from tigas_render.raster.cuda.packing import pack
from tigas_render.raster.cuda.scene import CHUNK

if TYPE_CHECKING:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

SCENE = pack(cloud(1000, 0).batches(), torch.device("cpu"))
MEGABYTE = 1 << 20
SHRUNK_AFTER = 8
BYTES_OF_A_SPLAT = 48
"""In all buffers of a workspace together."""


@pytest.fixture
def gpu() -> Iterator[FakeGpu]:
    with fake_gpu() as gpu:
        yield gpu


@pytest.fixture
def rasterizer(gpu: FakeGpu, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CudaRasterizer:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    monkeypatch.setattr(sys.modules["tigas_render.raster.cuda.workspace"], "SHRUNK_AFTER", SHRUNK_AFTER)
    return CudaRasterizer(0, tmp_path)


def frame(rasterizer: CudaRasterizer, width: int = 64, format: FrameFormat = "png") -> bytes:
    return rasterizer.render(SCENE, camera(width, width), format).encode(format, 90)


def frames_in_flight(rasterizer: CudaRasterizer, count: int) -> None:
    """Make frames, each in a separate workspace."""
    for job in [rasterizer.job(SCENE, camera(64, 64), "png", 90, depth=False) for _ in range(count)]:
        job.run()


def test_a_frame_whose_lists_are_too_short_is_drawn_again(gpu: FakeGpu, rasterizer: CudaRasterizer) -> None:
    gpu.entries = 10 * MEGABYTE
    assert frame(rasterizer)
    assert gpu.frames == 2
    assert frame(rasterizer)
    assert gpu.frames == 3, "the lists stay long"


def test_a_frame_that_shows_more_of_its_scene_than_there_is_room_for_is_drawn_again(
    gpu: FakeGpu, rasterizer: CudaRasterizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["tigas_render.raster.cuda.workspace"], "FIRST_ROOM", 1)
    frame(rasterizer)
    before, gpu.chunks = gpu.allocated, 3
    frame(rasterizer)
    assert gpu.frames == 3
    assert gpu.allocated - before == 2 * CHUNK * BYTES_OF_A_SPLAT
    frame(rasterizer)
    assert gpu.frames == 4, "the room stays"


def test_a_frame_with_too_many_entries_is_refused(gpu: FakeGpu, rasterizer: CudaRasterizer) -> None:
    frame(rasterizer)
    before, gpu.entries = gpu.allocated, 2**32 - 1
    with pytest.raises(Overloaded, match="request a smaller image"):
        frame(rasterizer)
    assert gpu.allocated == before
    gpu.entries = 1000
    assert frame(rasterizer)
    assert gpu.encoders == 2, "its workspace is used again"


def test_lists_that_stay_nearly_empty_are_given_back(gpu: FakeGpu, rasterizer: CudaRasterizer) -> None:
    frame(rasterizer)
    before, gpu.entries = gpu.allocated, 100 * MEGABYTE
    frame(rasterizer)
    gpu.entries = 1000
    for _ in range(SHRUNK_AFTER):
        frame(rasterizer)
    assert gpu.allocated > 10 * before, "not while one of the last frames needed them"
    for _ in range(SHRUNK_AFTER + 1):
        frame(rasterizer)
    assert gpu.allocated == before


def test_a_frame_is_drawn_again_when_only_its_depth_found_the_lists_too_short(
    gpu: FakeGpu, rasterizer: CudaRasterizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed = iter([10 * MEGABYTE, 1000, 1000, 1000])  # of depth, picture; depth, picture
    draw = gpu.draw

    def draw_next() -> None:
        gpu.entries = next(needed)
        draw()

    monkeypatch.setattr(gpu, "draw", draw_next)
    image = rasterizer.render(SCENE, camera(64, 64), "png", depth=True)
    assert gpu.frames == 4
    assert image.coded_depth is not None


def test_a_frame_without_depth_after_one_with_it_has_none(gpu: FakeGpu, rasterizer: CudaRasterizer) -> None:
    for depth in (True, False):
        image = rasterizer.render(SCENE, camera(64, 64), "png", depth=depth)
        assert (image.coded_depth is not None) is depth
    assert gpu.encoders == 2, "in the same workspace"


def test_lists_that_cannot_grow_are_an_error_and_take_no_memory_until_they_can(
    gpu: FakeGpu, rasterizer: CudaRasterizer
) -> None:
    frame(rasterizer)
    gpu.capacity, before = gpu.allocated, gpu.allocated
    gpu.entries = 10 * MEGABYTE
    with pytest.raises(OutOfDeviceMemory, match=r"^cuda:0 has too little free memory; try again later\.$"):
        frame(rasterizer)
    assert gpu.allocated < before
    gpu.capacity = 1000 * MEGABYTE
    assert frame(rasterizer)
    assert gpu.encoders == 2, "its workspace is used again"


def test_once_memory_was_short_the_next_frame_finds_what_idle_workspaces_kept(
    gpu: FakeGpu, rasterizer: CudaRasterizer
) -> None:
    frames_in_flight(rasterizer, 3)
    gpu.capacity, idle = gpu.allocated, gpu.allocated
    with pytest.raises(OutOfDeviceMemory):
        frame(rasterizer, 2000)
    assert gpu.allocated > 0.9 * idle, "not at once: the engine unloads a scene first"
    assert frame(rasterizer, 2000)
    assert gpu.encoders == 6
    gpu.capacity = 1000 * MEGABYTE
    frames_in_flight(rasterizer, 3)
    assert gpu.allocated > idle, "what is enough again is kept again"


def test_once_memory_was_short_the_driver_finds_what_pytorch_kept(gpu: FakeGpu, rasterizer: CudaRasterizer) -> None:
    frame(rasterizer, 2000)
    gpu.allocate(100 * MEGABYTE)  # gone at once
    assert gpu.cached >= 100 * MEGABYTE
    gpu.jpeg_status = 5  # no memory: nvJPEG asks the driver, and cannot know of PyTorch's
    with pytest.raises(OutOfDeviceMemory):
        frame(rasterizer, 2000, "jpeg")
    gpu.jpeg_status = 0
    assert frame(rasterizer, 2000, "jpeg")
    assert gpu.cached == 0


FAILURES: dict[str, tuple[dict[str, Any], FrameFormat, type[Exception]]] = {
    "the driver has no memory": ({"launch_result": "CUDA_ERROR_OUT_OF_MEMORY"}, "jpeg", OutOfDeviceMemory),
    "the driver finds that out late": ({"sync_result": "CUDA_ERROR_OUT_OF_MEMORY"}, "jpeg", OutOfDeviceMemory),
    "there is none for a copy": ({"copy_result": "CUDA_ERROR_OUT_OF_MEMORY"}, "png", OutOfDeviceMemory),
    "nvJPEG has none": ({"jpeg_status": 5}, "jpeg", OutOfDeviceMemory),
    "nvJPEG fails": ({"jpeg_status": 2}, "jpeg", RuntimeError),
}


@pytest.mark.parametrize(("failure", "format", "expected"), FAILURES.values(), ids=FAILURES.keys())
def test_one_failure_costs_one_request(
    gpu: FakeGpu,
    rasterizer: CudaRasterizer,
    failure: dict[str, Any],
    format: FrameFormat,
    expected: type[Exception],
) -> None:
    frame(rasterizer, format=format)
    with pytest.MonkeyPatch.context() as patched:
        for name, value in failure.items():
            patched.setattr(gpu, name, value)
        with pytest.raises(expected) as raised:
            frame(rasterizer, format=format)
    assert type(raised.value) is not DeviceLost
    assert frame(rasterizer, format=format)
    assert gpu.encoders == 2, "its workspace is used again"


@pytest.mark.parametrize(
    ("jpeg_status", "reason"),
    [(0, "cuStreamSynchronize failed: CUDA_ERROR_ILLEGAL_ADDRESS"), (2, "nvjpegEncodeYUV failed with status 2")],
)
def test_a_failure_after_which_nothing_works_is_a_lost_gpu(
    gpu: FakeGpu, rasterizer: CudaRasterizer, jpeg_status: int, reason: str
) -> None:
    frame(rasterizer, format="jpeg")
    gpu.lost, gpu.jpeg_status = True, jpeg_status
    with pytest.raises(DeviceLost) as lost:
        frame(rasterizer, format="jpeg")
    assert lost.value.detail == f"cuda:0 failed ({reason}); restart the service."


def test_a_gpu_that_cannot_be_opened_is_one_sentence(
    gpu: FakeGpu, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from tigas_render.raster.cuda.rasterizer import CudaRasterizer

    def full(device: torch.device) -> tuple[int, int]:
        raise RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be reported later")

    monkeypatch.setattr(torch.cuda, "get_device_capability", full)
    with pytest.raises(ValueError, match=r"^cuda:0 cannot be used: CUDA error: out of memory\.$"):
        CudaRasterizer(0, tmp_path)
