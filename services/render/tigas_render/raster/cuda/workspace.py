"""Everything that one frame in flight needs on the device: a stream, buffers, graphs and a JPEG encoder."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import torch
from cuda.core import Kernel, Stream, launch
from cuda.core.graph import Graph

from tigas_common.errors import Overloaded
from tigas_common.wire.render import FrameFormat
from tigas_render.encode.depth_segment import CodedDepth
from tigas_render.raster.base import Camera, coarse
from tigas_render.raster.calls import Call, Calls
from tigas_render.raster.cuda.compiler import Stage
from tigas_render.raster.cuda.nvidia import JpegEncoder, NvJpeg, driver_call
from tigas_render.raster.cuda.parameters import LAYOUT, PixelFormat, TileLayout, tile_layout, write_frame
from tigas_render.raster.cuda.scene import CHUNK, CudaScene

FIRST_CAPACITY = 1 << 21
"""Entries of all tiles' lists together that a workspace begins with; it grows when a frame needs more."""
MOST_ENTRIES = 1 << 30
"""Entries beyond which a frame is refused: its lists would take 8 GiB, and keep the device busy for seconds."""
SHRUNK_AFTER = 1024
"""Frames after which lists that none of them filled to a tenth are given back."""

MOST_PLANS = 64
"""Number of picture sizes for which a workspace keeps its plan."""

# As in frame.cuh.
DEPTH_BINS = 8192
MAX_SEGMENTS = 64
PROGRESS_BYTES = 4 * (DEPTH_BINS + 8 + MAX_SEGMENTS)
DEPTH_THREADS = 1024
ENTRIES_PER_PARTIAL = 256
"""Capacity of the lists, over the number of partial pictures that there is room for."""

DEPTH_QUALITY = 28
"""JPEG quality of encoded depth, as accurate as the WebP of the CPU path."""


class Parameters:
    """Of one launch: where the first kernel takes the frame's parameters from, and where it is to store them."""

    def __init__(self, frame: int) -> None:
        """frame: an address on the device."""
        self._content = ctypes.create_string_buffer(LAYOUT.size)
        self._frame = ctypes.c_void_p(frame)
        self._pointers = (ctypes.c_void_p * 2)(ctypes.addressof(self._content), ctypes.addressof(self._frame))
        self.arguments = ctypes.addressof(self._pointers)
        """The address of the kernel's arguments."""
        self._pointer = (ctypes.c_void_p * 1)(ctypes.addressof(self._frame))
        self.frame_alone = ctypes.addressof(self._pointer)
        """That of the arguments of a kernel which takes nothing but where the parameters are stored."""

    def write(self, scene: CudaScene, camera: Camera, format: PixelFormat, plan: Plan) -> None:
        """Describe the next frame."""
        write_frame(self._content, scene, camera, plan.layout, format, plan.addresses, plan.capacity)


@dataclass(frozen=True, slots=True)
class Plan:
    """Constants of all frames of a size."""

    layout: TileLayout
    addresses: tuple[int, ...]
    """As `write_frame` takes them."""
    capacity: int
    """Entries that the lists have room for."""


class Workspace:
    """One frame at a time goes through it. Nothing is allocated for a frame that fits the buffers of the last."""

    def __init__(
        self, device: torch.device, stages: dict[int, tuple[Stage, ...]], code_depth: Kernel, library: NvJpeg
    ) -> None:
        """stages: the kernels of a frame in their order, by the side of a tile."""
        self._device = device
        self._stages = stages
        self.torch_stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self.stream: Stream = Stream.from_handle(self.torch_stream.cuda_stream)
        wait = driver_call("cuStreamSynchronize", int(self.stream.handle))
        self._wait = Calls(wait)
        self._copy = Calls(driver_call("cuMemcpyDtoHAsync_v2", 0, 0, 0, int(self.stream.handle)), wait)
        self._status = torch.zeros(3, dtype=torch.int32, pin_memory=True)
        status = self._status.data_ptr()
        self._needed, self._needed_for_depth = (ctypes.c_uint32.from_address(status + offset) for offset in (0, 4))
        self._nearest = ctypes.c_float.from_address(status + 8)  # follows the depth's needs, as `code_depth` stores it
        self._most_needed, self._fitting = 0, 0
        """The largest number of entries in the last frames that fitted, and the number of those frames."""
        self._buffers: dict[str, torch.Tensor] = {}
        self._plans: dict[tuple[int, int, int, PixelFormat], Plan] = {}
        """Of frames that the buffers have room for, by width, height, Gaussians and format."""
        self._output = torch.empty(0, dtype=torch.uint8)
        self._length = ctypes.c_size_t()
        """Bytes of it that are the last frame's."""
        self._depth_output = torch.empty(0, dtype=torch.uint8)
        self._depth: tuple[int, int] | None = None
        """Columns and rows of the last frame's depth; None if it has no depth."""
        self._allocate("frame", LAYOUT.size)
        self._allocate("progress", PROGRESS_BYTES).zero_()
        torch.cuda.current_stream(device).synchronize()
        self._parameters, self._depth_parameters = (Parameters(self._buffers["frame"].data_ptr()) for _ in range(2))
        self._graphs = {side: self._capture(of_side) for side, of_side in stages.items()}
        self._launches: dict[tuple[int, Parameters], Calls] = {}
        """By the side of tiles."""
        block = (1, 1, 1, DEPTH_THREADS, 1, 1)
        arguments = self._parameters.frame_alone
        self._code_depth = Calls(
            driver_call("cuLaunchKernel", int(code_depth.handle), *block, 0, int(self.stream.handle), arguments, 0)
        )
        # last, as they have to be closed
        self._encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait)
        self._depth_encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait, gray=True)

    @property
    def entries(self) -> int:
        """Entries of all lists of the last frame that was finished."""
        return self._needed.value

    def drawing(
        self, scene: CudaScene, camera: Camera, format: FrameFormat, *, depth: bool = False
    ) -> tuple[Calls, ...]:
        """The calls that queue one frame, and its depth; valid until the next `drawing`.

        Raises torch.cuda.OutOfMemoryError if the buffers have to grow and cannot.
        """
        self._needed_for_depth.value = 0
        self._depth = None
        plan = self._plan(scene, camera, format)
        of_depth: tuple[Calls, ...] = ()
        if depth:
            small = coarse(camera)
            plan_of_depth = self._plan(scene, small, "depth")
            plan = self._plan(scene, camera, format)  # buffers may have moved, but have room for both now
            self._depth_parameters.write(scene, small, "depth", plan_of_depth)
            self._depth = small.intrinsics.width, small.intrinsics.height
            of_depth = self._launch(plan_of_depth.layout.side, self._depth_parameters), self._code_depth
        self._parameters.write(scene, camera, format, plan)
        return *of_depth, self._launch(plan.layout.side, self._parameters)

    def prepare(self, scene: CudaScene, camera: Camera, format: FrameFormat) -> TileLayout:
        """Make room for a frame and write its parameters, but launch nothing."""
        plan = self._plan(scene, camera, format)
        self._parameters.write(scene, camera, format, plan)
        return plan.layout

    def _launch(self, side: int, parameters: Parameters) -> Calls:
        """The calls that queue a frame with tiles of a given side."""
        found = self._launches.get((side, parameters))
        if found is None:
            first = self._first_launch(self._stages[side][0], parameters)
            graph = driver_call("cuGraphLaunch", int(self._graphs[side].handle), int(self.stream.handle))
            found = self._launches[side, parameters] = Calls(first, graph)
        return found

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
            ("depth", 9 * width * height)  # floats, and their codes
            if format == "depth"
            else ("pixels", 3 * width * height + 4 * max(width, height)),  # planes of odd sizes take a bit more
        )
        addresses = tuple(self._allocate(name, size).data_ptr() for name, size in sizes)
        status = ctypes.addressof(self._needed_for_depth if format == "depth" else self._needed)
        others = (status, self._buffers["progress"].data_ptr())
        return Plan(layout, addresses + others, capacity)

    def fetching(self, width: int, height: int, format: FrameFormat, quality: int) -> tuple[Calls, ...]:
        """The calls that encode a frame queued in this format, copy it to the host and wait for it."""
        pixels = self._buffers["pixels"].data_ptr()
        if format == "jpeg":
            output = self._output = _at_least(self._encoder.bound(width, height), self._output)
            self._length = self._encoder.length
            encode, fetch = self._encoder.encoding(pixels, width, height, quality, output.data_ptr(), output.nbytes)
            picture: tuple[Calls, ...] = (encode,)
        else:
            self._length = ctypes.c_size_t(picture_bytes(width, height, format))
            output = self._output = _at_least(self._length.value, self._output)
            self._copy.replace(0, 0, output.data_ptr(), pixels, self._length.value)
            picture, fetch = (), self._copy
        if self._depth is None:
            return *picture, fetch
        columns, rows = self._depth
        output = self._depth_output = _at_least(self._depth_encoder.bound(columns, rows), self._depth_output)
        codes = self._buffers["depth"].data_ptr() + 8 * columns * rows
        encode_depth, fetch_depth = self._depth_encoder.encoding(
            codes, columns, rows, DEPTH_QUALITY, output.data_ptr(), output.nbytes
        )
        return *picture, encode_depth, fetch, fetch_depth

    def wait(self) -> None:
        """Wait for all queued work."""
        self._wait.make()

    def output(self) -> bytes:
        """A copy of the encoded frame on the host."""
        return ctypes.string_at(self._output.data_ptr(), self._length.value)

    def coded_depth(self) -> CodedDepth | None:
        """A copy of the frame's encoded depth on the host; None if it was queued without depth."""
        if self._depth is None:
            return None
        image = ctypes.string_at(self._depth_output.data_ptr(), self._depth_encoder.length.value)
        return CodedDepth(self._nearest.value, image)

    def fitted(self) -> bool:
        """Whether the finished frame's lists had room; if not, they are enlarged and the frame has to be redrawn.

        Raises Overloaded for a frame with more than `MOST_ENTRIES`.
        """
        needed = max(self._needed.value, self._needed_for_depth.value)
        if needed > MOST_ENTRIES:
            raise Overloaded("The view shows too many large Gaussians to draw; ask for a smaller picture.")
        room = self._buffers["entries"].nbytes // 8
        if needed > room:
            self._allocate("entries", 8 * needed * 5 // 4)
            return False
        self._most_needed, self._fitting = max(self._most_needed, needed), self._fitting + 1
        if self._fitting == SHRUNK_AFTER:
            if 10 * max(self._most_needed, FIRST_CAPACITY) < room:
                self._plans.clear()
                del self._buffers["entries"], self._buffers["partials"]
            self._most_needed, self._fitting = 0, 0
        return True

    def shrink(self) -> None:
        """Release buffers that grew with scenes and pictures; the next frame allocates them again."""
        self.wait()
        self._plans.clear()
        self._buffers = {name: self._buffers[name] for name in ("frame", "progress")}

    def close(self) -> None:
        """Give the encoder's memory back; the buffers go with the object."""
        self.wait()
        self._encoder.close()
        self._depth_encoder.close()

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
        """All kernels but the first as one graph: differences between frames are in the parameters that they read."""
        builder = self.stream.create_graph_builder()
        builder.begin_building("relaxed")
        for stage in stages[1:]:
            launch(builder, stage.config, stage.kernel, self._buffers["frame"].data_ptr())
        return builder.end_building().complete()

    def _allocate(self, name: str, size: int) -> torch.Tensor:
        """The buffer of this name, enlarged if it has less than `size` bytes; then its content is lost."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.nbytes < size:
            # Growing waits for the stream: running kernels may use the old buffer. It is released before the new one is
            # allocated; if memory is short, none is left.
            self.wait()
            self._plans.clear()
            self._buffers[name] = torch.empty(0, dtype=torch.uint8, device=self._device)
            del buffer
            buffer = torch.empty(size, dtype=torch.uint8, device=self._device)
            # PyTorch does not know this workspace's stream: earlier work on the memory, on the default stream, may
            # still be queued there, such as another scene's packing.
            torch.cuda.current_stream(self._device).synchronize()
            self._buffers[name] = buffer
        return buffer


def _at_least(size: int, buffer: torch.Tensor) -> torch.Tensor:
    """The buffer, of pinned memory, or a larger one."""
    return buffer if buffer.nbytes >= size else torch.empty(size, dtype=torch.uint8, pin_memory=True)


def picture_bytes(width: int, height: int, format: FrameFormat) -> int:
    """Bytes of a picture's pixels, as `png` or `yuv420p` lays them out."""
    match format:
        case "png":
            return 3 * width * height
        case "yuv420p":
            return width * height + 2 * ((width + 1) // 2) * ((height + 1) // 2)
        case _:
            raise ValueError(f"{format} has no pixels of its own")
