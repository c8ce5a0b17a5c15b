"""The CUDA rasteriser: hands each frame to a workspace of its own, so that several are in flight."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from cuda.core import Device
from cuda.core._utils.cuda_utils import CUDAError  # no public name yet
from numpy.typing import NDArray

from tigas_common.errors import DeviceLost, OutOfDeviceMemory
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire.render import FrameFormat
from tigas_render.encode.png import encode_png
from tigas_render.gaussians import Batches, Gaussians
from tigas_render.raster.base import Camera, Image, Pause, PreparedScene, one_gaussian
from tigas_render.raster.calls import Calls
from tigas_render.raster.cuda.compiler import load_kernels
from tigas_render.raster.cuda.nvjpeg import ALLOCATOR_FAILURE, NvJpeg, NvJpegError
from tigas_render.raster.cuda.scene import CudaScene, pack
from tigas_render.raster.cuda.workspace import Workspace, make_stages
from tigas_render.raster.lanes import FetchedImage, Job, LaneRasterizer

SIDES = (8, 16)
"""Tiles' sides that there are kernels for."""
STAGES = ("project", "large", "bin", "blend")
KERNELS = ("begin", "place", "code_depth", *(f"{stage}_{side}" for side in SIDES for stage in STAGES))


class CudaRasterizer(LaneRasterizer):
    """Renders on one NVIDIA GPU (Ampere or newer). `render` from one thread at a time; images encode on any."""

    frames_in_flight = lanes = 6

    def __init__(self, index: int, cache: Path) -> None:
        """index: the device's number; cache: a directory for compiled kernels.

        Raises ValueError, with one sentence, if the device cannot be used.
        """
        self.device = f"cuda:{index}"
        self._device = torch.device(self.device)
        self._free: list[Workspace] = []
        self._lock = threading.Lock()
        self._threads = threading.local()
        self._full = False
        try:
            self._open(index, cache)
        except (RuntimeError, CUDAError) as error:  # a full GPU, a driver that is too old, a library that is missing
            raise ValueError(f"{self.device} cannot be used: {_first_line(error)}.") from error

    def _open(self, index: int, cache: Path) -> None:
        capability = torch.cuda.get_device_capability(self._device)
        if capability < (8, 0):
            name = torch.cuda.get_device_name(self._device)
            raise ValueError(f"{name} is too old: the CUDA rasteriser needs an Ampere GPU or newer.")
        self.enter_thread()
        program = load_kernels(f"sm_{capability[0]}{capability[1]}", cache)
        kernels = {name: program.get_kernel(name) for name in KERNELS}
        self.stages = {side: make_stages(Device(index), kernels, side) for side in SIDES}
        self._code_depth = kernels["code_depth"]
        self._library = NvJpeg()

    @property
    def hardware(self) -> str:
        return torch.cuda.get_device_name(self._device)

    def pack(self, scene: Batches) -> CudaScene:
        """Pack a scene; see `scene.pack`. Raises OutOfDeviceMemory and DeviceLost."""
        with self.explained():
            self._make_room()
            packed = pack(scene, self._device)
            torch.cuda.current_stream(self._device).synchronize()  # frames read it from other streams
            return packed

    def prepare(self, gaussians: Gaussians) -> CudaScene:
        return self.pack(gaussians.batches())

    def render(
        self,
        scene: PreparedScene,
        camera: Camera,
        format: FrameFormat = "jpeg",
        pause: Pause | None = None,
        *,
        depth: bool = False,
    ) -> CudaImage:
        """Queue one view and return at once. Raises OutOfDeviceMemory and DeviceLost."""
        assert isinstance(scene, CudaScene)
        with self.explained():
            self._make_room()
            workspace = self.take_workspace()
            try:
                return CudaImage(self, workspace, scene, camera, format, with_depth=depth)
            except BaseException:
                self.give_back(workspace)
                raise

    def job(self, scene: PreparedScene, camera: Camera, format: FrameFormat, quality: int, *, depth: bool) -> CudaJob:
        """One view for a lane. Raises OutOfDeviceMemory and DeviceLost."""
        assert isinstance(scene, CudaScene)
        with self.explained():
            self._make_room()
            return CudaJob(self, self.take_workspace(), scene, camera, format, quality, depth)

    def warm_up(self) -> None:
        """Render and encode JPEGs in every workspace, so that everything is loaded and allocated."""
        scene = self.prepare(one_gaussian())
        pose = Pose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        for width, height in ((64, 36), (1280, 720)):
            camera = Camera(pose, Intrinsics(width, width, width / 2, height / 2, width, height))
            images = [self.render(scene, camera, depth=True) for _ in range(self.frames_in_flight + 1)]
            for image in images:
                with image:
                    image.encode("jpeg", 90)

    def take_workspace(self) -> Workspace:
        """A free workspace, made anew if there is none."""
        with self._lock:
            if self._free:
                return self._free.pop()
        return Workspace(self._device, self.stages, self._code_depth, self._library)

    def give_back(self, workspace: Workspace) -> None:
        """Take a workspace back; more than are in flight at a time are not kept."""
        with self._lock:
            if len(self._free) <= self.frames_in_flight:  # one more, for who renders beside the frames in flight
                self._free.append(workspace)
                return
        workspace.close()

    def enter_thread(self) -> None:
        """Make the device this thread's."""
        if not hasattr(self._threads, "is_current"):
            torch.cuda.set_device(self._device)
            Device(self._device.index).set_current()
            self._threads.is_current = True

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Makes the device current for this thread, and turns its errors into sentences."""
        try:
            self.enter_thread()
            yield
        except (RuntimeError, CUDAError) as error:
            if _is_out_of_memory(error):
                self._full = True
                raise OutOfDeviceMemory(f"{self.device} has too little free memory; try again later.") from None
            if self._works():
                raise  # the failure of this one request
            # Every call fails after a kernel crashed or the GPU fell off the bus; only a new process helps.
            raise DeviceLost(f"{self.device} failed ({_first_line(error)}); restart the service.") from error

    def _make_room(self) -> None:
        """Once memory was short: give the driver back what idle workspaces and PyTorch keep for later.

        Not at once, but before the next frame or scene: by then a scene may have been unloaded, too.
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


def _is_out_of_memory(error: Exception) -> bool:
    """PyTorch, the driver, the runtime (for pinned memory) and nvJPEG each say it in their own way."""
    if isinstance(error, torch.cuda.OutOfMemoryError) or (
        isinstance(error, NvJpegError) and error.status == ALLOCATOR_FAILURE
    ):
        return True
    return "out of memory" in str(error).lower().replace("_", " ")


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0].rstrip(".") or type(error).__name__


class CudaImage(Image):
    """A view that the device is rendering, or has rendered."""

    def __init__(
        self,
        rasterizer: CudaRasterizer,
        workspace: Workspace,
        scene: CudaScene,
        camera: Camera,
        format: FrameFormat,
        *,
        with_depth: bool,
    ) -> None:
        self.width, self.height = camera.intrinsics.width, camera.intrinsics.height
        self._rasterizer = rasterizer
        self._workspace: Workspace | None = workspace
        self._scene = scene  # held until the device is done with it
        self._camera = camera
        self._format = format
        self._with_depth = with_depth
        self._finished = False
        self._draw(workspace)

    def encode(self, format: FrameFormat, quality: int) -> bytes:
        """The image in a file format. Rendered again if its pixels were laid out for another.

        Raises OutOfDeviceMemory, DeviceLost, and ValueError once the image is closed.
        """
        encoded = self._encoded(format, quality)
        return encode_png(self._rgb(encoded)) if format == "png" else encoded

    def _encoded(self, format: FrameFormat, quality: int) -> bytes:
        """The image on the host; for `png`, its RGB pixels."""
        workspace = self._workspace
        if workspace is None:
            raise ValueError("the image is closed")
        with self._rasterizer.explained():
            again = format != self._format
            while True:
                if again:
                    self._format, self._finished = format, False
                    self._draw(workspace)
                for calls in workspace.fetching(self.width, self.height, format, quality):
                    calls.make()
                again = not workspace.fitted()
                if not again:
                    break
            self._finished = True
            self.depth = workspace.depth()
            return workspace.output()

    def _draw(self, workspace: Workspace) -> None:
        depth: Literal["floats"] | None = "floats" if self._with_depth else None
        for calls in workspace.drawing(self._scene, self._camera, self._format, depth):
            calls.make()

    def _rgb(self, encoded: bytes) -> NDArray[np.uint8]:
        return np.frombuffer(encoded, np.uint8).reshape(self.height, self.width, 3)

    def to_host(self) -> NDArray[np.uint8]:
        """A copy of the pixels. Raises what `encode` raises."""
        return self._rgb(self._encoded("png", 0)).copy()

    def close(self) -> None:
        """Give the workspace back, once the device is done with it."""
        workspace, self._workspace = self._workspace, None
        if workspace is None:
            return
        try:
            if not self._finished:
                with self._rasterizer.explained():
                    workspace.wait()
        finally:
            self._rasterizer.give_back(workspace)


@dataclass
class CudaJob(Job):
    """A view for a lane."""

    rasterizer: CudaRasterizer
    workspace: Workspace
    scene: CudaScene
    camera: Camera
    format: FrameFormat
    quality: int
    with_depth: bool

    def calls(self) -> tuple[tuple[Calls, ...], tuple[Calls, ...]]:
        """Raises OutOfDeviceMemory and DeviceLost."""
        k = self.camera.intrinsics
        drawing = self.workspace.drawing(self.scene, self.camera, self.format, "coded" if self.with_depth else None)
        return drawing, self.workspace.fetching(k.width, k.height, self.format, self.quality)

    def fetched(self) -> FetchedImage | None:
        """Copies of what is on the host now."""
        if not self.workspace.fitted():
            return None
        k = self.camera.intrinsics
        return FetchedImage(k.width, k.height, self.format, self.workspace.output(), self.workspace.coded_depth())

    def explained(self) -> AbstractContextManager[None]:
        return self.rasterizer.explained()

    def close(self, *, failed: bool) -> None:
        """Give the workspace back, once the device is done with it."""
        try:
            if failed:
                with suppress(Exception), self.explained():
                    self.workspace.wait()
        finally:
            self.rasterizer.give_back(self.workspace)
