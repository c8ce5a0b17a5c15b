"""Everything that one frame in flight needs on the device: a stream, buffers, graphs and a JPEG encoder."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np
import torch
from cuda.core import Device, Kernel, LaunchConfig, Stream, launch
from cuda.core.graph import Graph

from tigas_common.wire.render import FrameFormat
from tigas_render.raster.base import Camera, Depth
from tigas_render.raster.cuda.calls import Call, Calls
from tigas_render.raster.cuda.driver import driver_call
from tigas_render.raster.cuda.layout import TileLayout, tile_layout
from tigas_render.raster.cuda.nvjpeg import JpegEncoder, NvJpeg
from tigas_render.raster.cuda.parameters import LAYOUT, PixelFormat, write_frame
from tigas_render.raster.cuda.scene import CHUNK, CudaScene
from tigas_render.raster.depth import coarse, inverse_depth

FIRST_CAPACITY = 1 << 21
"""Entries of all tiles' lists together that a workspace begins with; it grows when a frame needs more."""

MOST_PLANS = 64
"""Sizes of pictures of which a workspace keeps what it has planned."""

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


class Parameters:
    """Of one launch: where the first kernel takes the frame's parameters from, and where it is to store them."""

    def __init__(self, frame: int) -> None:
        """frame: an address on the device."""
        self._content = ctypes.create_string_buffer(LAYOUT.size)
        self._frame = ctypes.c_void_p(frame)
        self._pointers = (ctypes.c_void_p * 2)(ctypes.addressof(self._content), ctypes.addressof(self._frame))
        self.arguments = ctypes.addressof(self._pointers)
        """The address of the kernel's arguments."""

    def write(self, scene: CudaScene, camera: Camera, format: PixelFormat, plan: Plan) -> None:
        """Describe the next frame."""
        write_frame(self._content, scene, camera, plan.layout, format, plan.addresses, plan.capacity)


@dataclass(frozen=True, slots=True)
class Plan:
    """What is the same for all frames of a size."""

    layout: TileLayout
    addresses: tuple[int, ...]
    """As `write_frame` takes them."""
    capacity: int
    """Entries that the lists have room for."""


class Workspace:
    """One frame at a time goes through it. Nothing is allocated for a frame that fits the buffers of the last."""

    def __init__(self, device: torch.device, stages: dict[int, tuple[Stage, ...]], library: NvJpeg) -> None:
        """stages: the kernels of a frame in their order, by the side of a tile."""
        self._device = device
        self._stages = stages
        self.torch_stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self.stream: Stream = Stream.from_handle(self.torch_stream.cuda_stream)
        wait = driver_call("cuStreamSynchronize", int(self.stream.handle))
        self._wait = Calls(wait)
        self._status = torch.zeros(2, dtype=torch.int32, pin_memory=True)
        self._needed, self._needed_for_depth = (
            ctypes.c_uint32.from_address(self._status.data_ptr() + offset) for offset in (0, 4)
        )
        self._buffers: dict[str, torch.Tensor] = {}
        self._plans: dict[tuple[int, int, int, PixelFormat], Plan] = {}
        """Of frames that the buffers have room for, by width, height, Gaussians and format."""
        self._output = torch.empty(0, dtype=torch.uint8)
        self._depth_output = torch.empty(0, dtype=torch.uint8)
        self._depth_shape: tuple[int, int, int] | None = None
        """Of what the frame that was started last has in `_depth_output`; None if it has no depth."""
        self._allocate("frame", LAYOUT.size)
        self._allocate("progress", PROGRESS_BYTES).zero_()
        torch.cuda.current_stream(device).synchronize()
        self._parameters, self._depth_parameters = (Parameters(self._buffers["frame"].data_ptr()) for _ in range(2))
        self._graphs = {side: self._capture(of_side) for side, of_side in stages.items()}
        self._launches: dict[tuple[int | None, int], Calls] = {}
        """What is called for a frame, by the sides of its tiles: those of its depth, if it has one, and its own."""
        self._encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait)  # last: it has to be closed

    @property
    def entries(self) -> int:
        """Entries of all lists of the last frame that was finished."""
        return self._needed.value

    def start(self, scene: CudaScene, camera: Camera, format: FrameFormat, *, depth: bool = False) -> None:
        """Queue one frame, and its depth. Raises torch.cuda.OutOfMemoryError if the buffers have to grow and cannot."""
        self._needed_for_depth.value = 0
        self._depth_shape = None
        side_of_depth = None
        plan = self._plan(scene, camera, format)
        if depth:
            small = coarse(camera)
            plan_of_depth = self._plan(scene, small, "depth")
            plan = self._plan(scene, camera, format)  # buffers may have moved, but have room for both now
            self._depth_parameters.write(scene, small, "depth", plan_of_depth)
            self._depth_shape = (small.intrinsics.height, small.intrinsics.width, 2)
            side_of_depth = plan_of_depth.layout.side
        self._parameters.write(scene, camera, format, plan)
        calls = self._calls(side_of_depth, plan.layout.side)
        if self._depth_shape is not None:
            length = 4 * math.prod(self._depth_shape)
            if self._depth_output.nbytes < length:
                self._depth_output = torch.empty(length, dtype=torch.uint8, pin_memory=True)
            calls.replace(2, 0, self._depth_output.data_ptr(), self._buffers["depth"].data_ptr(), length)
        calls.make()

    def prepare(self, scene: CudaScene, camera: Camera, format: FrameFormat) -> TileLayout:
        """Make room for a frame and write its parameters, but launch nothing."""
        plan = self._plan(scene, camera, format)
        self._parameters.write(scene, camera, format, plan)
        return plan.layout

    def _calls(self, side_of_depth: int | None, side: int) -> Calls:
        """What queues a frame, by the sides of its tiles, and of those of its depth, if it has one."""
        found = self._launches.get((side_of_depth, side))
        if found is None:
            stream = int(self.stream.handle)
            calls = []
            if side_of_depth is not None:
                calls = [*self._launch(side_of_depth, self._depth_parameters)]
                calls.append(driver_call("cuMemcpyDtoHAsync_v2", 0, 0, 0, stream))
            found = Calls(*calls, *self._launch(side, self._parameters))
            self._launches[side_of_depth, side] = found
        return found

    def _launch(self, side: int, parameters: Parameters) -> tuple[Call, Call]:
        first = self._first_launch(self._stages[side][0], parameters)
        return first, driver_call("cuGraphLaunch", int(self._graphs[side].handle), int(self.stream.handle))

    def _plan(self, scene: CudaScene, camera: Camera, format: PixelFormat) -> Plan:
        """Room for a frame. It stays where it is until another frame needs more."""
        k = camera.intrinsics
        key = k.width, k.height, scene.padded, format
        plan = self._plans.get(key)
        if plan is None:
            plan = self._make_room(*key)  # first, since no other plan is left if it enlarges a buffer
            if len(self._plans) >= MOST_PLANS:
                self._plans.clear()
            self._plans[key] = plan
        return plan

    def _make_room(self, width: int, height: int, padded: int, format: PixelFormat) -> Plan:
        layout = tile_layout(width, height, padded)
        capacity = self._allocate("entries", 8 * FIRST_CAPACITY).nbytes // 8
        lists = 4 * layout.tiles * layout.slices
        sizes = (
            ("splats", 32 * padded),
            ("depths", 4 * padded),
            ("boxes", 8 * padded),
            ("chosen", 4 * (padded // CHUNK)),
            ("large", 4 * padded),
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
            ("depth", 8 * width * height)
            if format == "depth"
            else ("pixels", 3 * width * height + 4 * max(width, height)),  # planes of odd sizes take a bit more
        )
        addresses = tuple(self._allocate(name, size).data_ptr() for name, size in sizes)
        status = ctypes.addressof(self._needed_for_depth if format == "depth" else self._needed)
        others = (status, self._buffers["progress"].data_ptr())
        return Plan(layout, addresses + others, capacity)

    def encode_jpeg(self, width: int, height: int, quality: int) -> int:
        """Encode a frame that was started as `jpeg`, and wait for it. The JPEG's bytes."""
        output = self._host_output(self._encoder.bound(width, height))
        pixels = self._buffers["pixels"].data_ptr()
        return self._encoder.encode(pixels, width, height, quality, output.data_ptr(), output.nbytes)

    def copy_pixels(self, length: int) -> None:
        """Copy the first bytes of the pixels to the host, and wait for them."""
        output = self._host_output(length)
        with torch.cuda.stream(self.torch_stream):
            output[:length].copy_(self._buffers["pixels"][:length], non_blocking=True)
        self.wait()

    def wait(self) -> None:
        """Wait for everything queued."""
        self._wait.make()

    def output(self, length: int) -> bytes:
        """The first bytes that were brought to the host."""
        return ctypes.string_at(self._output.data_ptr(), length)

    def depth(self) -> Depth | None:
        """The depth of the frame, once it was waited for; None if it was started without."""
        if self._depth_shape is None:
            return None
        means = ctypes.string_at(self._depth_output.data_ptr(), 4 * math.prod(self._depth_shape))
        return inverse_depth(np.frombuffer(means, np.float32).reshape(self._depth_shape))

    def fitted(self) -> bool:
        """Whether the lists of the frame that was waited for found room. If not, they have: start the frame again."""
        needed = max(self._needed.value, self._needed_for_depth.value)
        if 8 * needed <= self._buffers["entries"].nbytes:
            return True
        self._allocate("entries", 8 * needed * 5 // 4)
        return False

    def shrink(self) -> None:
        """Give back what grew with scenes and pictures; the next frame allocates what it needs."""
        self.wait()
        self._plans.clear()
        self._buffers = {name: self._buffers[name] for name in ("frame", "progress")}

    def close(self) -> None:
        """Give the encoder's memory back; the buffers go with the object."""
        self.wait()
        self._encoder.close()

    def launch_stage(self, stage: Stage) -> None:
        """Launch one kernel by itself; benchmarks time them so."""
        if stage.name == "begin":
            Calls(self._first_launch(stage, self._parameters)).make()
        else:
            launch(self.stream, stage.config, stage.kernel, self._buffers["frame"].data_ptr())

    def _first_launch(self, stage: Stage, parameters: Parameters) -> Call:
        """Of the first kernel, which brings the parameters along."""
        kernel, stream, shape = int(stage.kernel.handle), int(self.stream.handle), stage.config
        return driver_call("cuLaunchKernel", kernel, *shape.grid, *shape.block, 0, stream, parameters.arguments, 0)

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
            self.wait()
            self._plans.clear()
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
