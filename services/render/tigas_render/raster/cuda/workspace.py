"""The resources of a frame in flight on the device: a stream, buffers, graphs and JPEG encoders."""

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
from tigas_render.raster.calls import Call, Calls, FrameCalls
from tigas_render.raster.cuda.compiler import MAX_RANGES, Stage
from tigas_render.raster.cuda.nvidia import JpegEncoder, NvJpeg, driver_call
from tigas_render.raster.cuda.parameters import (
    SIZE,
    PixelFormat,
    TileLayout,
    frame_parameters,
    plan_numbers,
    tile_layout,
)
from tigas_render.raster.cuda.scene import CHUNK, CudaScene

FIRST_CAPACITY = 1 << 21
"""Initial number of list entries in a workspace, for all tiles. It grows when a frame needs more."""
MOST_ENTRIES = 1 << 30
"""Number of entries above which a frame is refused: its lists would take 8 GiB, and seconds of the device's time."""
FIRST_ROOM = 1 << 12
"""Initial number of chunks for which a workspace has room. It grows when a frame chooses more."""
SHRUNK_AFTER = 1024
"""Number of frames after which buffers are released if all of them used less than a tenth of the entries or chunks."""

MOST_KINDS = 256
"""Maximum number of kinds of frames, by size, format and quality, that a workspace keeps prepared."""

# As in frame.cuh.
DEPTH_BINS = 8192
MAX_SEGMENTS = 64
PROGRESS_BYTES = 4 * (DEPTH_BINS + 10 + MAX_SEGMENTS + MAX_RANGES)
DEPTH_THREADS = 1024
ENTRIES_PER_PARTIAL = 256
"""Number of list entries per partial image for which there is room."""

DEPTH_QUALITY = 28
"""JPEG quality of encoded depth, which is as accurate as the WebP of the CPU path."""


class Status(ctypes.Structure):
    """The status that a drawn frame or its depth leaves in pinned memory."""

    _fields_ = (
        ("entries", ctypes.c_uint32),
        ("chunks", ctypes.c_uint32),
        ("nearest", ctypes.c_float),
        ("_unused", ctypes.c_uint32),  # to align the next one
    )
    entries: int
    """Number of list entries needed."""
    chunks: int
    """Number of chunks chosen."""
    nearest: float
    """Inverse depth of code 255, for depth only."""


class Parameters:
    """The kernel arguments of a launch: the frame's parameters, and where the first kernel stores them."""

    def __init__(self, frame: int) -> None:
        """frame: device address at which the parameters are stored."""
        self._content = ctypes.create_string_buffer(SIZE)
        self._frame = ctypes.c_void_p(frame)
        self._pointers = (ctypes.c_void_p * 2)(ctypes.addressof(self._content), ctypes.addressof(self._frame))
        self.arguments = ctypes.addressof(self._pointers)
        """Address of the first kernel's arguments."""
        self._pointer = (ctypes.c_void_p * 1)(ctypes.addressof(self._frame))
        self.frame_alone = ctypes.addressof(self._pointer)
        """Address of the arguments of a kernel that takes only the address of the stored parameters."""

    def write(self, scene: CudaScene, camera: Camera, plan: Plan) -> None:
        self._content.raw = frame_parameters(scene, camera, plan.numbers)


@dataclass(frozen=True, slots=True)
class Plan:
    """The constants of all frames of a size and format."""

    layout: TileLayout
    numbers: bytes
    """Input of `frame_parameters`."""
    capacity: int
    """Number of entries for which the lists have room."""
    room: int
    """Number of chunks for which the other buffers have room."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """The image or the depth of a kind of frames."""

    plan: Plan
    encode: tuple[Call, ...]
    fetch: tuple[Call, ...]
    output: torch.Tensor
    """Pinned memory, which starts at `address`."""
    address: int
    room: int
    """Maximum size of the encoded layer in bytes."""
    length: ctypes.c_size_t
    """Size of the encoded layer in bytes after a frame; set to `room` before it."""

    def content(self) -> bytes:
        """A copy of the encoded layer on the host."""
        return ctypes.string_at(self.address, self.length.value)


@dataclass(frozen=True, slots=True, eq=False)
class FrameKind:
    """The prepared calls and outputs of all frames of a size, format and quality, with or without depth."""

    calls: FrameCalls
    picture: Layer
    depth: Layer | None


class Workspace:
    """Renders one frame at a time. Allocates nothing for a frame that fits in the existing buffers."""

    def __init__(
        self, device: torch.device, stages: dict[int, tuple[Stage, ...]], code_depth: Kernel, library: NvJpeg
    ) -> None:
        """stages: the kernels of a frame in order, by the side length of a tile."""
        self._device = device
        self._stages = stages
        self.torch_stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self.stream: Stream = Stream.from_handle(self.torch_stream.cuda_stream)
        wait = driver_call("cuStreamSynchronize", int(self.stream.handle))
        self._wait_call, self._wait = wait, Calls(wait)
        self._pinned = torch.zeros(2 * ctypes.sizeof(Status), dtype=torch.uint8, pin_memory=True)
        self._status, self._depth_status = (
            Status.from_address(self._pinned.data_ptr() + at) for at in (0, ctypes.sizeof(Status))
        )
        self._room = FIRST_ROOM
        """Number of chunks for which frames of large scenes have room."""
        self._most_entries, self._most_chunks, self._fitting = 0, 0, 0
        """Maximum entries and chunks of the last frames that fitted, and the number of those frames."""
        self._buffers: dict[str, torch.Tensor] = {}
        self._plans: dict[tuple[int, int, int, PixelFormat], Plan] = {}
        """Plans for which the buffers have room, by width, height, number of Gaussians and format."""
        self._kinds: dict[tuple[int, int, int, FrameFormat, int, bool], FrameKind] = {}
        """Prepared kinds of frames, by width, height, number of Gaussians, format, quality, and presence of depth."""
        self._kind: FrameKind
        """The kind of the last frame."""
        self._output, self._depth_output = (torch.empty(0, dtype=torch.uint8) for _ in range(2))
        self._allocate("frame", SIZE)
        self._allocate("progress", PROGRESS_BYTES).zero_()
        torch.cuda.current_stream(device).synchronize()
        self._parameters, self._depth_parameters = (Parameters(self._buffers["frame"].data_ptr()) for _ in range(2))
        self._graphs = {side: self._capture(of_side) for side, of_side in stages.items()}
        block = (1, 1, 1, DEPTH_THREADS, 1, 1)
        arguments = self._parameters.frame_alone
        self._code_depth = driver_call(
            "cuLaunchKernel", int(code_depth.handle), *block, 0, int(self.stream.handle), arguments, 0
        )
        # created last, because they have to be closed
        self._encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait)
        self._depth_encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait, gray=True)

    @property
    def entries(self) -> int:
        """Number of entries in all lists of the last finished frame."""
        return self._status.entries

    def frame(
        self, scene: CudaScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool = False
    ) -> FrameCalls:
        """The calls that draw, encode and fetch one frame and its depth, valid until the next call of `frame`.

        Raises torch.cuda.OutOfMemoryError if the buffers have to grow but cannot.
        """
        k = camera.intrinsics
        key = k.width, k.height, scene.padded, format, quality, depth
        kind = self._kinds.get(key) or self._make_kind(key, scene, camera)
        self._kind = kind
        self._depth_status.entries = self._depth_status.chunks = 0
        self._parameters.write(scene, camera, kind.picture.plan)
        kind.picture.length.value = kind.picture.room
        if kind.depth is not None:
            self._depth_parameters.write(scene, coarse(camera), kind.depth.plan)
            kind.depth.length.value = kind.depth.room
        return kind.calls

    def _make_kind(
        self, key: tuple[int, int, int, FrameFormat, int, bool], scene: CudaScene, camera: Camera
    ) -> FrameKind:
        width, height, _, format, quality, has_depth = key
        plan = self._plan(scene, camera, format)
        depth: Layer | None = None
        draw: tuple[Call, ...] = ()
        if has_depth:
            small = coarse(camera)
            plan_of_depth = self._plan(scene, small, "depth")
            plan = self._plan(scene, camera, format)  # again: buffers may have moved, but now have room for both
            depth = self._depth(plan_of_depth, small.intrinsics.width, small.intrinsics.height)
            draw = *self._launch(plan_of_depth.layout.side, self._depth_parameters), self._code_depth
        picture = self._picture(plan, width, height, format, quality)
        draw += self._launch(plan.layout.side, self._parameters)
        layers = (picture,) if depth is None else (picture, depth)
        fetch = [call for layer in layers for call in layer.encode] + [call for layer in layers for call in layer.fetch]
        if len(self._kinds) >= MOST_KINDS:
            self._kinds.clear()
        kind = self._kinds[key] = FrameKind(FrameCalls(draw, fetch), picture, depth)
        return kind

    def prepare(self, scene: CudaScene, camera: Camera, format: FrameFormat) -> TileLayout:
        """Make room for a frame and write its parameters, without launching anything."""
        plan = self._plan(scene, camera, format)
        self._parameters.write(scene, camera, plan)
        return plan.layout

    def _launch(self, side: int, parameters: Parameters) -> tuple[Call, ...]:
        """The calls that queue a frame with tiles of this side length."""
        first = self._first_launch(self._stages[side][0], parameters)
        return first, driver_call("cuGraphLaunch", int(self._graphs[side].handle), int(self.stream.handle))

    def _plan(self, scene: CudaScene, camera: Camera, format: PixelFormat) -> Plan:
        """The plan of a frame, with room for it in the buffers, which move only when a frame needs more room."""
        k = camera.intrinsics
        key = k.width, k.height, scene.padded, format
        plan = self._plans.get(key)
        if plan is None:
            plan = self._make_room(*key)  # first, because it clears all plans if it enlarges a buffer
            if len(self._plans) >= MOST_KINDS:
                self._plans.clear()
            self._plans[key] = plan
        return plan

    def _make_room(self, width: int, height: int, padded: int, format: PixelFormat) -> Plan:
        layout = tile_layout(width, height, padded)
        room = min(padded // CHUNK, self._room)
        slots = room * CHUNK
        capacity = self._allocate("entries", 8 * FIRST_CAPACITY).nbytes // 8
        lists = 4 * layout.tiles * layout.slices
        sizes = (
            ("splats", 32 * slots),
            ("depths", 4 * slots),
            ("boxes", 8 * slots),
            ("chosen", 4 * (padded // CHUNK)),
            ("large", 4 * slots),
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
            else ("pixels", 3 * width * height + 4 * max(width, height)),  # planes of odd sizes take slightly more
        )
        addresses = tuple(self._allocate(name, size).data_ptr() for name, size in sizes)
        status = ctypes.addressof(self._depth_status if format == "depth" else self._status)
        others = (status, self._buffers["progress"].data_ptr())
        numbers = plan_numbers(width, height, padded, layout, format, addresses + others, capacity, room)
        return Plan(layout, numbers, capacity, room)

    def _picture(self, plan: Plan, width: int, height: int, format: FrameFormat, quality: int) -> Layer:
        pixels, is_jpeg = self._buffers["pixels"].data_ptr(), format == "jpeg"
        room = self._encoder.bound(width, height) if is_jpeg else picture_bytes(width, height, format)
        output = self._output = _at_least(room, self._output)
        address = output.data_ptr()
        if is_jpeg:
            encode = self._encoder.encoding(pixels, width, height, quality)
            return Layer(plan, encode, self._encoder.fetching(address), output, address, room, self._encoder.length)
        copy = driver_call("cuMemcpyDtoHAsync_v2", address, pixels, room, int(self.stream.handle))
        return Layer(plan, (), (copy, self._wait_call), output, address, room, ctypes.c_size_t())

    def _depth(self, plan: Plan, columns: int, rows: int) -> Layer:
        encoder = self._depth_encoder
        room = encoder.bound(columns, rows)
        output = self._depth_output = _at_least(room, self._depth_output)
        address = output.data_ptr()
        codes = self._buffers["depth"].data_ptr() + 8 * columns * rows
        encode = encoder.encoding(codes, columns, rows, DEPTH_QUALITY)
        return Layer(plan, encode, encoder.fetching(address), output, address, room, encoder.length)

    def wait(self) -> None:
        self._wait.make()

    def output(self) -> bytes:
        """A copy of the encoded frame on the host."""
        return self._kind.picture.content()

    def coded_depth(self) -> CodedDepth | None:
        """A copy of the frame's encoded depth on the host; None for a frame without depth."""
        depth = self._kind.depth
        return None if depth is None else CodedDepth(self._depth_status.nearest, depth.content())

    def fitted(self) -> bool:
        """Whether the finished frame fitted in the buffers; if not, they have been enlarged and it must be redrawn.

        Raises Overloaded for a frame with more than `MOST_ENTRIES`.
        """
        entries = max(self._status.entries, self._depth_status.entries)
        chunks = max(self._status.chunks, self._depth_status.chunks)
        if entries > MOST_ENTRIES:
            raise Overloaded("The view shows too many large Gaussians to draw; request a smaller image.")
        plan = self._kind.picture.plan
        if chunks > plan.room:
            self._room = chunks * 5 // 4
            self._forget_kinds()
        if entries > plan.capacity:
            self._allocate("entries", 8 * entries * 5 // 4)
        if chunks > plan.room or entries > plan.capacity:
            return False
        self._most_entries, self._most_chunks = max(self._most_entries, entries), max(self._most_chunks, chunks)
        self._fitting += 1
        if self._fitting == SHRUNK_AFTER:
            lists_idle = 10 * max(self._most_entries, FIRST_CAPACITY) < plan.capacity
            room_idle = 10 * max(self._most_chunks, FIRST_ROOM) < self._room
            if lists_idle or room_idle:
                self.shrink()
            self._most_entries, self._most_chunks, self._fitting = 0, 0, 0
        return True

    def shrink(self) -> None:
        """Release buffers that have grown with scenes and images; the next frame allocates them again."""
        self.wait()
        self._forget_kinds()
        self._room = FIRST_ROOM
        self._buffers = {name: self._buffers[name] for name in ("frame", "progress")}

    def close(self) -> None:
        """Release the encoders' memory. The buffers are released with the object."""
        self.wait()
        self._encoder.close()
        self._depth_encoder.close()

    def launch_stage(self, stage: Stage) -> None:
        """Launch a single kernel, for benchmarks."""
        if stage.name == "begin":
            Calls(self._first_launch(stage, self._parameters)).make()
        else:
            launch(self.stream, stage.config, stage.kernel, self._buffers["frame"].data_ptr())

    def _first_launch(self, stage: Stage, parameters: Parameters) -> Call:
        """The launch of the first kernel, which passes the parameters to the device."""
        kernel, stream, shape = int(stage.kernel.handle), int(self.stream.handle), stage.config
        return driver_call("cuLaunchKernel", kernel, *shape.grid, *shape.block, 0, stream, parameters.arguments, 0)

    def _capture(self, stages: tuple[Stage, ...]) -> Graph:
        """Capture all kernels but the first in a graph. Frames differ only in the parameters that the kernels read."""
        builder = self.stream.create_graph_builder()
        builder.begin_building("relaxed")
        for stage in stages[1:]:
            launch(builder, stage.config, stage.kernel, self._buffers["frame"].data_ptr())
        return builder.end_building().complete()

    def _forget_kinds(self) -> None:
        """Forget prepared frames, because buffers move or are released."""
        self._plans.clear()
        self._kinds.clear()

    def _allocate(self, name: str, size: int) -> torch.Tensor:
        """The buffer of this name. If it has less than `size` bytes it is enlarged, and its content is lost."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.nbytes < size:
            # Running kernels may use the old buffer, so wait for the stream. The old buffer is released before the new
            # one is allocated; if there is not enough memory, there is no buffer afterwards.
            self.wait()
            self._forget_kinds()
            self._buffers[name] = torch.empty(0, dtype=torch.uint8, device=self._device)
            del buffer
            buffer = torch.empty(size, dtype=torch.uint8, device=self._device)
            # PyTorch does not know this workspace's stream, so earlier work on this memory, such as packing another
            # scene, may still be queued on the default stream.
            torch.cuda.current_stream(self._device).synchronize()
            self._buffers[name] = buffer
        return buffer


def _at_least(size: int, buffer: torch.Tensor) -> torch.Tensor:
    """The pinned buffer, or a new one if it is too small."""
    return buffer if buffer.nbytes >= size else torch.empty(size, dtype=torch.uint8, pin_memory=True)


def picture_bytes(width: int, height: int, format: FrameFormat) -> int:
    """Size in bytes of an image's pixels, in the layout for `png` or `yuv420p`."""
    match format:
        case "png":
            return 3 * width * height
        case "yuv420p":
            return width * height + 2 * ((width + 1) // 2) * ((height + 1) // 2)
        case _:
            raise ValueError(f"{format} has no pixels of its own")
