"""Everything that one frame in flight needs on the device: a stream, buffers, graphs and a JPEG encoder."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np
import torch
from cuda.bindings import driver
from cuda.core import Device, Kernel, LaunchConfig, Stream, launch
from cuda.core.graph import Graph

from tigas_common.wire.render import FrameFormat
from tigas_render.raster.base import Camera, Depth
from tigas_render.raster.cuda.layout import TileLayout, tile_layout
from tigas_render.raster.cuda.nvjpeg import JpegEncoder, NvJpeg
from tigas_render.raster.cuda.parameters import LAYOUT, PixelFormat, write_frame
from tigas_render.raster.cuda.scene import CHUNK, CudaScene
from tigas_render.raster.depth import coarse, inverse_depth

FIRST_CAPACITY = 1 << 21
"""Entries of all tiles' lists together that a workspace begins with; it grows when a frame needs more."""

# As in frame.cuh.
DEPTH_BINS = 8192
MAX_SEGMENTS = 64
PROGRESS_BYTES = 4 * (DEPTH_BINS + 7 + MAX_SEGMENTS)
ENTRIES_PER_PARTIAL = 256
"""Capacity of the lists, over the number of partial pictures that there is room for."""


@dataclass(frozen=True, slots=True)
class Stage:
    """One kernel of a frame and how it is launched. Every grid is as large as the device can hold at once."""

    name: str
    kernel: Kernel
    config: LaunchConfig


class Workspace:
    """One frame at a time goes through it. Nothing is allocated for a frame that fits the buffers of the last."""

    def __init__(self, device: torch.device, stages: dict[int, tuple[Stage, ...]], library: NvJpeg) -> None:
        """stages: the kernels of a frame in their order, by the side of a tile."""
        self._device = device
        self._stages = stages
        self.torch_stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self.stream: Stream = Stream.from_handle(self.torch_stream.cuda_stream)
        self._parameters = ctypes.create_string_buffer(LAYOUT.size)
        self._status = torch.zeros(2, dtype=torch.int32, pin_memory=True)
        self._needed, self._needed_for_depth = (
            ctypes.c_uint32.from_address(self._status.data_ptr() + offset) for offset in (0, 4)
        )
        self._buffers: dict[str, torch.Tensor] = {}
        self._output = torch.empty(0, dtype=torch.uint8)
        self._depth_output = torch.empty(0, dtype=torch.uint8)
        self._depth_shape: tuple[int, int, int] | None = None
        """Of what the frame that was started last has in `_depth_output`; None if it has no depth."""
        self._allocate("frame", LAYOUT.size)
        self._allocate("progress", PROGRESS_BYTES).zero_()
        torch.cuda.current_stream(device).synchronize()
        self._graphs = {side: self._capture(of_side) for side, of_side in stages.items()}
        self._encoder = JpegEncoder(library, self.torch_stream.cuda_stream)  # last: it has to be closed

    @property
    def entries(self) -> int:
        """Entries of all lists of the last frame that was finished."""
        return self._needed.value

    def start(self, scene: CudaScene, camera: Camera, format: FrameFormat, *, depth: bool = False) -> None:
        """Queue one frame. Raises torch.cuda.OutOfMemoryError if the buffers have to grow and cannot."""
        self._needed_for_depth.value = 0
        self._depth_shape = None
        if depth:
            self._start_depth(scene, coarse(camera))
        self._launch(scene, camera, format)

    def _start_depth(self, scene: CudaScene, camera: Camera) -> None:
        """Queue a small picture of depth, and its copy to the host."""
        self._launch(scene, camera, "depth")
        self._depth_shape = (camera.intrinsics.height, camera.intrinsics.width, 2)
        length = 4 * math.prod(self._depth_shape)
        if self._depth_output.nbytes < length:
            self._depth_output = torch.empty(length, dtype=torch.uint8, pin_memory=True)
        with torch.cuda.stream(self.torch_stream):
            self._depth_output[:length].copy_(self._buffers["depth"][:length], non_blocking=True)

    def _launch(self, scene: CudaScene, camera: Camera, format: PixelFormat) -> None:
        side = self.prepare(scene, camera, format).side
        self.begin(self._stages[side][0])
        self._graphs[side].launch(self.stream)

    def prepare(self, scene: CudaScene, camera: Camera, format: PixelFormat) -> TileLayout:
        """Make room for a frame and write its parameters, but launch nothing."""
        k = camera.intrinsics
        layout = tile_layout(k.width, k.height, scene.padded)
        capacity = self._allocate("entries", 8 * FIRST_CAPACITY).nbytes // 8
        lists = 4 * layout.tiles * layout.slices
        sizes = (
            ("splats", 32 * scene.padded),
            ("depths", 4 * scene.padded),
            ("boxes", 8 * scene.padded),
            ("chosen", 4 * (scene.padded // CHUNK)),
            ("large", 4 * scene.padded),
            ("slice_of", DEPTH_BINS),
            ("counts", lists),
            ("starts", lists),
            ("ends", lists),
            ("entries", 0),
            ("queue", 4 * layout.tiles * MAX_SEGMENTS),
            ("partial_of", 4 * layout.tiles),
            ("finished", 4 * layout.tiles),
            ("lights", 4 * layout.tiles * MAX_SEGMENTS),
            ("partials", capacity // ENTRIES_PER_PARTIAL * layout.side**2 * 16),
            ("depth", 8 * k.width * k.height)
            if format == "depth"
            else ("pixels", 3 * k.width * k.height + 4 * max(k.width, k.height)),  # planes of odd sizes take a bit more
        )
        addresses = tuple(self._allocate(name, size).data_ptr() for name, size in sizes)
        status = ctypes.addressof(self._needed_for_depth if format == "depth" else self._needed)
        others = (status, self._buffers["progress"].data_ptr())
        write_frame(self._parameters, scene, camera, layout, format, addresses + others, capacity)
        return layout

    def encode_jpeg(self, width: int, height: int, quality: int) -> int:
        """Queue the encoding of a frame that was started as `jpeg`; waits for its length. The JPEG's bytes."""
        self._encoder.encode(self._buffers["pixels"].data_ptr(), width, height, quality)
        output = self._host_output(self._encoder.bound(width, height))
        return self._encoder.retrieve(output.data_ptr(), output.nbytes)

    def copy_pixels(self, length: int) -> None:
        """Queue the copy of the first bytes of the pixels to the host."""
        output = self._host_output(length)
        with torch.cuda.stream(self.torch_stream):
            output[:length].copy_(self._buffers["pixels"][:length], non_blocking=True)

    def output(self, length: int) -> bytes:
        """The first bytes that a queued copy brought to the host, once `finish` has waited for it."""
        return ctypes.string_at(self._output.data_ptr(), length)

    def depth(self) -> Depth | None:
        """The depth of the frame, once `finish` has waited for it; None if it was started without."""
        if self._depth_shape is None:
            return None
        means = ctypes.string_at(self._depth_output.data_ptr(), 4 * math.prod(self._depth_shape))
        return inverse_depth(np.frombuffer(means, np.float32).reshape(self._depth_shape))

    def finish(self) -> bool:
        """Wait for everything queued. False if the lists overflowed: they have been enlarged, start the frame again."""
        self.stream.sync()
        needed = max(self._needed.value, self._needed_for_depth.value)
        if 8 * needed <= self._buffers["entries"].nbytes:
            return True
        self._allocate("entries", 8 * needed * 5 // 4)
        return False

    def shrink(self) -> None:
        """Give back what grew with scenes and pictures; the next frame allocates what it needs."""
        self.stream.sync()
        self._buffers = {name: self._buffers[name] for name in ("frame", "progress")}

    def close(self) -> None:
        """Give the encoder's memory back; the buffers go with the object."""
        self.stream.sync()
        self._encoder.close()

    def launch_stage(self, stage: Stage) -> None:
        """Launch one kernel by itself; benchmarks time them so."""
        if stage.name == "begin":
            self.begin(stage)
        else:
            launch(self.stream, stage.config, stage.kernel, self._buffers["frame"].data_ptr())

    def begin(self, stage: Stage) -> None:
        """Launch the first kernel, which brings the parameters along."""
        frame = ctypes.c_void_p(self._buffers["frame"].data_ptr())
        arguments = (ctypes.c_void_p * 2)(ctypes.addressof(self._parameters), ctypes.addressof(frame))
        (error,) = driver.cuLaunchKernel(
            driver.CUfunction(int(stage.kernel.handle)), *stage.config.grid, *stage.config.block, 0,
            driver.CUstream(int(self.stream.handle)), ctypes.addressof(arguments), 0,
        )  # fmt: skip
        if error != driver.CUresult.CUDA_SUCCESS:
            raise RuntimeError(f"the first kernel was not launched: {error.name}")

    def _capture(self, stages: tuple[Stage, ...]) -> Graph:
        """All kernels but the first as one graph: what differs between frames is in the parameters that they read."""
        builder = self.stream.create_graph_builder()
        builder.begin_building("relaxed")
        for stage in stages[1:]:
            launch(builder, stage.config, stage.kernel, self._buffers["frame"].data_ptr())
        return builder.end_building().complete()

    def _allocate(self, name: str, size: int) -> torch.Tensor:
        """The buffer of this name, enlarged if it has less than `size` bytes; then its content is lost."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.nbytes < size:
            # Growing waits for the stream: what still runs may use the old buffer. It goes before the new one comes,
            # and if there is no memory for that, none is left.
            self.stream.sync()
            self._buffers[name] = torch.empty(0, dtype=torch.uint8, device=self._device)
            del buffer
            buffer = torch.empty(size, dtype=torch.uint8, device=self._device)
            # PyTorch knows nothing of this workspace's stream: what used the memory before, on the default stream, may
            # still be queued there, such as another scene's packing.
            torch.cuda.current_stream(self._device).synchronize()
            self._buffers[name] = buffer
        return buffer

    def _host_output(self, size: int) -> torch.Tensor:
        if self._output.nbytes < size:
            self._output = torch.empty(size, dtype=torch.uint8, pin_memory=True)
        return self._output


def make_stages(device: Device, kernels: dict[str, Kernel], side: int) -> tuple[Stage, ...]:
    """The kernels of a frame, for tiles of one size."""
    processors = device.properties.multiprocessor_count

    def stage(name: str, kernel: Kernel, threads: int) -> Stage:
        blocks = kernel.occupancy.max_active_blocks_per_multiprocessor(threads, 0)
        return Stage(name, kernel, LaunchConfig(grid=processors * blocks, block=threads))

    return (
        Stage("begin", kernels["begin"], LaunchConfig(grid=2 * processors, block=CHUNK)),
        stage("project", kernels[f"project_{side}"], CHUNK),
        stage("large", kernels[f"large_{side}"], CHUNK),
        stage("place", kernels["place"], CHUNK),
        stage("bin", kernels[f"bin_{side}"], CHUNK),
        stage("blend", kernels[f"blend_{side}"], 256),
    )
