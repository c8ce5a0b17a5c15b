"""The CUDA rasteriser, with a separate workspace for each frame in flight."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import torch
from cuda.core import Device
from cuda.core._utils.cuda_utils import CUDAError  # no public name yet

from tigas_common.errors import DeviceLost, OutOfDeviceMemory
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.gaussians import Batches
from tigas_render.raster.base import Camera, PreparedScene, one_gaussian
from tigas_render.raster.calls import FrameCalls
from tigas_render.raster.cuda.compiler import load_kernels, make_stages
from tigas_render.raster.cuda.nvidia import ALLOCATOR_FAILURE, NvJpeg, NvJpegError, wait_asleep
from tigas_render.raster.cuda.packing import pack
from tigas_render.raster.cuda.scene import CudaScene
from tigas_render.raster.cuda.workspace import Workspace
from tigas_render.raster.lanes import FetchedImage, Job, LaneRasterizer

SIDES = (8, 16)
"""Side lengths in pixels of the tiles for which there are kernels."""
STAGES = ("project", "large", "bin", "blend")
KERNELS = ("begin", "place", "code_depth", *(f"{stage}_{side}" for side in SIDES for stage in STAGES))


LEAST_LANES, MOST_LANES = 6, 24
LANE_BYTES = 2 << 30
"""Device memory per lane in bytes; a lane's buffers grow with scenes and images."""


class CudaRasterizer(LaneRasterizer):
    """Renders on one NVIDIA GPU (Ampere or newer). Create jobs on one thread at a time; they may run on any thread.

    Six frames in flight keep the device busy, and further lanes keep it so while finished ones wait for a busy event
    loop (docs/results/2026-11-engine-cost.md).
    """

    def __init__(self, index: int, cache: Path) -> None:
        """index: the device's number. cache: a directory for compiled kernels.

        Raises ValueError, with one sentence, if the device cannot be used.
        """
        self.device = f"cuda:{index}"
        self._device = torch.device(self.device)
        self._free: list[Workspace] = []
        self._lock = threading.Lock()
        self._threads = threading.local()
        self._full = False
        self.explained = Explained(self)
        try:
            self._open(index, cache)
        except (OSError, RuntimeError, CUDAError) as error:  # a GPU out of memory, or an old or missing driver
            raise ValueError(f"{self.device} cannot be used: {_first_line(error)}.") from error

    def _open(self, index: int, cache: Path) -> None:
        capability = torch.cuda.get_device_capability(self._device)
        if capability < (8, 0):
            name = torch.cuda.get_device_name(self._device)
            raise ValueError(f"{name} is too old: the CUDA rasteriser needs an Ampere GPU or newer.")
        wait_asleep(index)
        self.enter_thread()
        memory = torch.cuda.get_device_properties(self._device).total_memory
        self.frames_in_flight = max(LEAST_LANES, min(MOST_LANES, memory // LANE_BYTES))
        program = load_kernels(f"sm_{capability[0]}{capability[1]}", cache)
        kernels = {name: program.get_kernel(name) for name in KERNELS}
        self.stages = {side: make_stages(Device(index), kernels, side) for side in SIDES}
        self._code_depth = kernels["code_depth"]
        self._library = NvJpeg()

    @property
    def hardware(self) -> str:
        return torch.cuda.get_device_name(self._device)

    def pack(self, scene: Batches) -> CudaScene:
        """Pack a scene; see `packing.pack`. Raises OutOfDeviceMemory and DeviceLost."""
        with self.explained:
            self._make_room()
            packed = pack(scene, self._device)
            torch.cuda.current_stream(self._device).synchronize()  # frames read it from other streams
            return packed

    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> CudaJob:
        """Prepare one view in a workspace. Raises OutOfDeviceMemory and DeviceLost."""
        assert isinstance(scene, CudaScene)
        with self.explained:
            self._make_room()
            return CudaJob(self, self.take_workspace(), scene, camera, format, quality, depth)

    def warm_up(self) -> None:
        """Render JPEGs with depth in every workspace, so that everything is loaded and allocated."""
        scene = self.prepare(one_gaussian())
        pose = Pose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        for width, height in ((64, 36), (1280, 720)):
            camera = Camera(pose, Intrinsics(width, width, width / 2, height / 2, width, height))
            jobs = [self.job(scene, camera, "jpeg", 90, depth=True) for _ in range(self.frames_in_flight + 1)]
            for job in jobs:
                job.run()

    def take_workspace(self) -> Workspace:
        """A free workspace, or a new one."""
        with self._lock:
            if self._free:
                return self._free.pop()
        return Workspace(self._device, self.stages, self._code_depth, self._library)

    def give_back(self, workspace: Workspace) -> None:
        """Take back a workspace. One is kept for each frame in flight, and one for `render`."""
        with self._lock:
            if len(self._free) <= self.frames_in_flight:
                self._free.append(workspace)
                return
        workspace.close()

    def enter_thread(self) -> None:
        """Make the device current for this thread."""
        if not hasattr(self._threads, "is_current"):
            torch.cuda.set_device(self._device)
            Device(self._device.index).set_current()
            self._threads.is_current = True

    def explain(self, error: Exception) -> None:
        """Raise OutOfDeviceMemory or DeviceLost for a device error; do nothing for an error of a single request."""
        if _is_out_of_memory(error):
            self._full = True
            raise OutOfDeviceMemory(f"{self.device} has too little free memory; try again later.") from None
        if not self._works():
            # After a kernel has crashed or the GPU has fallen off the bus every call fails, until a new process starts.
            raise DeviceLost(f"{self.device} failed ({_first_line(error)}); restart the service.") from error

    def _make_room(self) -> None:
        """After a shortage of memory, return the caches of idle workspaces and of PyTorch to the driver.

        This happens before the next frame or scene, because by then a scene may have been unloaded as well.
        """
        if not self._full:
            return
        self._full = False
        with self._lock:
            for workspace in self._free:
                workspace.shrink()
        torch.cuda.empty_cache()

    def _works(self) -> bool:
        try:
            torch.cuda.synchronize(self._device)
        except RuntimeError:
            return False
        return True


class Explained(AbstractContextManager[None]):
    """A context manager that makes the device current for the thread, and translates its errors into the service's.

    It is stateless, so all threads share it. It is entered three times per frame; a generator took 3 µs each time.
    """

    def __init__(self, rasterizer: CudaRasterizer) -> None:
        self._rasterizer = rasterizer

    def __enter__(self) -> None:
        self._rasterizer.enter_thread()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, RuntimeError | CUDAError):
            self._rasterizer.explain(error)


def _is_out_of_memory(error: Exception) -> bool:
    """Whether PyTorch, the driver, the runtime (for pinned memory) or nvJPEG reports a lack of memory."""
    if isinstance(error, torch.cuda.OutOfMemoryError) or (
        isinstance(error, NvJpegError) and error.status == ALLOCATOR_FAILURE
    ):
        return True
    return "out of memory" in str(error).lower().replace("_", " ")


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


@dataclass(slots=True, eq=False)
class CudaJob(Job):
    """One view in a workspace."""

    rasterizer: CudaRasterizer
    workspace: Workspace
    scene: CudaScene
    camera: Camera
    format: FrameFormat
    quality: int
    with_depth: bool

    def calls(self) -> FrameCalls:
        """The calls of the frame. Raises OutOfDeviceMemory and DeviceLost."""
        return self.workspace.frame(self.scene, self.camera, self.format, self.quality, depth=self.with_depth)

    def fetched(self) -> FetchedImage | None:
        """The frame and its depth, copied from pinned memory; None if it must be redrawn. Raises Overloaded."""
        if not self.workspace.fitted():
            return None
        k, workspace = self.camera.intrinsics, self.workspace
        return FetchedImage(k.width, k.height, self.format, self.quality, workspace.output(), workspace.coded_depth())

    def explained(self) -> AbstractContextManager[None]:
        return self.rasterizer.explained

    def close(self, *, failed: bool) -> None:
        """Return the workspace once the device has finished with it."""
        try:
            if failed:
                with suppress(Exception), self.rasterizer.explained:
                    self.workspace.wait()
        finally:
            self.rasterizer.give_back(self.workspace)
