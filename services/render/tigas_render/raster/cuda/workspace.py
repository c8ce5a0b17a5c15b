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
"""Entries of all tiles' lists together that a workspace begins with; it grows when a frame needs more."""
MOST_ENTRIES = 1 << 30
"""Entries beyond which a frame is refused: its lists would take 8 GiB, and keep the device busy for seconds."""
FIRST_ROOM = 1 << 12
"""Chunks of Gaussians that a workspace begins with room for; it grows when a frame chooses more."""
SHRUNK_AFTER = 1024
"""Frames after which buffers are given back if none of them filled their lists, or their room, to a tenth."""

MOST_KINDS = 256
"""Number of kinds of frames, by size, format and quality, that a workspace has prepared."""

# As in frame.cuh.
DEPTH_BINS = 8192
MAX_SEGMENTS = 64
PROGRESS_BYTES = 4 * (DEPTH_BINS + 10 + MAX_SEGMENTS + MAX_RANGES)
DEPTH_THREADS = 1024
ENTRIES_PER_PARTIAL = 256
"""Capacity of the lists, over the number of partial pictures that there is room for."""

DEPTH_QUALITY = 28
"""JPEG quality of encoded depth, as accurate as the WebP of the CPU path."""


class Status(ctypes.Structure):
    """Left by a drawn frame, or its depth, in pinned memory."""

    _fields_ = (
        ("entries", ctypes.c_uint32),
        ("chunks", ctypes.c_uint32),
        ("nearest", ctypes.c_float),
        ("_unused", ctypes.c_uint32),  # so that the next one is aligned, too
    )
    entries: int
    """Entries that its lists needed."""
    chunks: int
    """Chunks that it chose."""
    nearest: float
    """Inverse depth of code 255; only of depth."""


class Parameters:
    """Of one launch: where the first kernel takes the frame's parameters from, and where it is to store them."""

    def __init__(self, frame: int) -> None:
        """frame: an address on the device."""
        self._content = ctypes.create_string_buffer(SIZE)
        self._frame = ctypes.c_void_p(frame)
        self._pointers = (ctypes.c_void_p * 2)(ctypes.addressof(self._content), ctypes.addressof(self._frame))
        self.arguments = ctypes.addressof(self._pointers)
        """The address of the kernel's arguments."""
        self._pointer = (ctypes.c_void_p * 1)(ctypes.addressof(self._frame))
        self.frame_alone = ctypes.addressof(self._pointer)
        """That of the arguments of a kernel which takes nothing but where the parameters are stored."""

    def write(self, scene: CudaScene, camera: Camera, plan: Plan) -> None:
        self._content.raw = frame_parameters(scene, camera, plan.numbers)


@dataclass(frozen=True, slots=True)
class Plan:
    """Constants of all frames of a size and format."""

    layout: TileLayout
    numbers: bytes
    """As `frame_parameters` takes them."""
    capacity: int
    """Entries that the lists have room for."""
    room: int
    """Chunks of Gaussians that the other buffers have room for."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """The picture of a kind of frames, or their depth."""

    plan: Plan
    encode: tuple[Call, ...]
    fetch: tuple[Call, ...]
    output: torch.Tensor
    """Pinned memory, from the address on."""
    address: int
    room: int
    """Bytes that the encoded layer can have."""
    length: ctypes.c_size_t
    """Bytes of the last one, after it; the room before."""

    def content(self) -> bytes:
        """A copy of the encoded layer on the host."""
        return ctypes.string_at(self.address, self.length.value)


@dataclass(frozen=True, slots=True, eq=False)
class FrameKind:
    """What all frames of a size, format and quality have in common, with depth or without."""

    calls: FrameCalls
    picture: Layer
    depth: Layer | None


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
        self._wait_call, self._wait = wait, Calls(wait)
        self._pinned = torch.zeros(2 * ctypes.sizeof(Status), dtype=torch.uint8, pin_memory=True)
        self._status, self._depth_status = (
            Status.from_address(self._pinned.data_ptr() + at) for at in (0, ctypes.sizeof(Status))
        )
        self._room = FIRST_ROOM
        """Chunks that frames of large scenes get room for."""
        self._most_entries, self._most_chunks, self._fitting = 0, 0, 0
        """The most that any of the last frames that fitted needed, and the number of those frames."""
        self._buffers: dict[str, torch.Tensor] = {}
        self._plans: dict[tuple[int, int, int, PixelFormat], Plan] = {}
        """Of frames that the buffers have room for, by width, height, Gaussians and format."""
        self._kinds: dict[tuple[int, int, int, FrameFormat, int, bool], FrameKind] = {}
        """Of such frames, by width, height, Gaussians, format, quality, and whether they have depth."""
        self._kind: FrameKind
        """Of the last frame."""
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
        # last, as they have to be closed
        self._encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait)
        self._depth_encoder = JpegEncoder(library, self.torch_stream.cuda_stream, wait, gray=True)

    @property
    def entries(self) -> int:
        """Entries of all lists of the last frame that was finished."""
        return self._status.entries

    def frame(
        self, scene: CudaScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool = False
    ) -> FrameCalls:
        """The calls that draw, encode and fetch one frame, and its depth; valid until the next `frame`.

        Raises torch.cuda.OutOfMemoryError if the buffers have to grow and cannot.
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
            plan = self._plan(scene, camera, format)  # buffers may have moved, but have room for both now
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
        """Make room for a frame and write its parameters, but launch nothing."""
        plan = self._plan(scene, camera, format)
        self._parameters.write(scene, camera, plan)
        return plan.layout

    def _launch(self, side: int, parameters: Parameters) -> tuple[Call, ...]:
        """The calls that queue a frame with tiles of a given side."""
        first = self._first_launch(self._stages[side][0], parameters)
        return first, driver_call("cuGraphLaunch", int(self._graphs[side].handle), int(self.stream.handle))

    def _plan(self, scene: CudaScene, camera: Camera, format: PixelFormat) -> Plan:
        """Room for a frame. It stays where it is until another frame needs more."""
        k = camera.intrinsics
        key = k.width, k.height, scene.padded, format
        plan = self._plans.get(key)
        if plan is None:
            plan = self._make_room(*key)  # first, since no other plan is left if it enlarges a buffer
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
            else ("pixels", 3 * width * height + 4 * max(width, height)),  # planes of odd sizes take a bit more
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
        """A copy of the frame's encoded depth on the host; None if it was queued without depth."""
        depth = self._kind.depth
        return None if depth is None else CodedDepth(self._depth_status.nearest, depth.content())

    def fitted(self) -> bool:
        """Whether the finished frame had room; if not, buffers are enlarged and the frame has to be redrawn.

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
        """Release buffers that grew with scenes and pictures; the next frame allocates them again."""
        self.wait()
        self._forget_kinds()
        self._room = FIRST_ROOM
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

    def _forget_kinds(self) -> None:
        """Prepare frames anew: buffers move, or are released."""
        self._plans.clear()
        self._kinds.clear()

    def _allocate(self, name: str, size: int) -> torch.Tensor:
        """The buffer of this name, enlarged if it has less than `size` bytes; then its content is lost."""
        buffer = self._buffers.get(name)
        if buffer is None or buffer.nbytes < size:
            # Growing waits for the stream: running kernels may use the old buffer. It is released before the new one is
            # allocated; if memory is short, none is left.
            self.wait()
            self._forget_kinds()
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
