"""A GPU that draws nothing but runs out of memory, fails and is lost as a real one does.

It stands in for what the CUDA rasteriser calls outside this repository: PyTorch's allocator and streams, the driver,
cuda.core and nvJPEG's library. Its memory is the host's.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import torch

from tigas_render.raster.cuda.parameters import LAYOUT

USERS = tuple(f"tigas_render.raster.cuda.{name}" for name in ("nvjpeg", "rasterizer", "workspace"))
"""Our modules that import what is replaced."""
STATUS = 20
"""Where in a frame's parameters the address is at which it leaves the entries that its lists needed."""


class CUDAError(Exception):
    """cuda.core's."""


class FakeGpu:
    """Counts its memory in bytes. A test sets what goes wrong."""

    def __init__(self) -> None:
        self.capacity = 1 << 40
        self.allocated = 0
        """What tensors take."""
        self.cached = 0
        """What PyTorch keeps of tensors that are gone."""
        self.entries = 1000
        """What the lists of a frame need."""
        self.frames = 0
        """How many were drawn."""
        self.encoders = 0
        """How many JPEG encoders there are: one for each workspace."""
        self.launch_result = "CUDA_SUCCESS"
        self.sync_error: Exception | None = None
        self.jpeg_status = 0
        self.lost = False
        """Whether every call fails."""
        self._parameters = 0

    # -- memory ------------------------------------------------------------------------------------------------------

    def allocate(self, size: int) -> torch.Tensor:
        """Memory of the device. PyTorch gives back what it keeps before it says that there is none."""
        if self.allocated + self.cached + size > self.capacity:
            self.cached = 0
        if self.allocated + size > self.capacity:
            raise torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate a tensor.")
        tensor = _zeros(size, dtype=torch.uint8)
        self.allocated += size
        weakref.finalize(tensor, self._freed, size)
        return tensor

    def _freed(self, size: int) -> None:
        self.allocated -= size
        self.cached += size

    def empty_cache(self) -> None:
        """Give the driver back what PyTorch keeps."""
        self.cached = 0

    # -- work --------------------------------------------------------------------------------------------------------

    def launch_first_kernel(self, *arguments: Any) -> tuple[SimpleNamespace]:
        """cuLaunchKernel: the first argument of the kernel is the frame's parameters."""
        self._parameters = ctypes.c_void_p.from_address(arguments[9]).value or 0
        return (CURESULTS[self.launch_result],)

    def draw(self) -> None:
        """The kernels of a frame after the first."""
        parameters = LAYOUT.unpack_from((ctypes.c_char * LAYOUT.size).from_address(self._parameters))
        ctypes.c_uint32.from_address(parameters[STATUS]).value = self.entries
        self.frames += 1

    def synchronize(self) -> None:
        """Wait for the device."""
        if self.lost:
            raise RuntimeError("CUDA error: an illegal memory access was encountered\nMore follows.")

    def sync(self) -> None:
        """Wait for a stream."""
        self.synchronize()
        if self.sync_error is not None:
            raise self.sync_error


CURESULTS = {name: SimpleNamespace(name=name) for name in ("CUDA_SUCCESS", "CUDA_ERROR_OUT_OF_MEMORY")}
_zeros = torch.zeros


@dataclass
class _NvJpeg:
    """nvJPEG's library: every function gives a status."""

    gpu: FakeGpu

    def __getattr__(self, name: str) -> Any:
        def function(*arguments: Any) -> int:
            if name == "nvjpegEncoderStateCreate":
                self.gpu.encoders += 1
            elif name == "nvjpegEncodeGetBufferSize":
                arguments[-1]._obj.value = 1000
            elif name == "nvjpegEncodeRetrieveBitstream":
                arguments[3]._obj.value = 10
            return self.gpu.jpeg_status if name == "nvjpegEncodeYUV" else 0

        setattr(self, name, function)
        return function


def _packages(gpu: FakeGpu) -> dict[str, ModuleType]:
    """CUDA's packages, as far as they are used."""

    def package(name: str, **members: Any) -> ModuleType:
        module = ModuleType(name)
        vars(module).update(members)
        return module

    kernel = SimpleNamespace(
        handle=1, occupancy=SimpleNamespace(max_active_blocks_per_multiprocessor=lambda threads, shared: 1)
    )
    builder = SimpleNamespace(
        begin_building=lambda mode: None,
        end_building=lambda: SimpleNamespace(complete=lambda: SimpleNamespace(launch=lambda stream: gpu.draw())),
    )
    stream = SimpleNamespace(handle=1, sync=gpu.sync, create_graph_builder=lambda: builder)
    driver = SimpleNamespace(
        CUfunction=int,
        CUstream=int,
        CUresult=SimpleNamespace(**CURESULTS),
        cuLaunchKernel=gpu.launch_first_kernel,
    )
    return {
        "cuda": package("cuda"),
        "cuda.bindings": package("cuda.bindings", driver=driver),
        "cuda.core": package(
            "cuda.core",
            Device=lambda index: SimpleNamespace(
                set_current=lambda: None, properties=SimpleNamespace(multiprocessor_count=2)
            ),
            Kernel=object,
            LaunchConfig=lambda grid, block: SimpleNamespace(grid=(grid, 1, 1), block=(block, 1, 1)),
            ObjectCode=SimpleNamespace(from_cubin=lambda code: SimpleNamespace(get_kernel=lambda name: kernel)),
            Program=lambda *_: SimpleNamespace(compile=lambda kind: SimpleNamespace(code=b"")),
            ProgramOptions=SimpleNamespace,
            Stream=SimpleNamespace(from_handle=lambda handle: stream),
            launch=lambda *_: None,
        ),
        "cuda.core.graph": package("cuda.core.graph", Graph=object),
        "cuda.core._utils": package("cuda.core._utils"),
        "cuda.core._utils.cuda_utils": package("cuda.core._utils.cuda_utils", CUDAError=CUDAError),
        "cuda.pathfinder": package(
            "cuda.pathfinder", load_nvidia_dynamic_lib=lambda name: SimpleNamespace(abs_path=name)
        ),
    }


@contextlib.contextmanager
def fake_gpu() -> Iterator[FakeGpu]:
    """The machine has this GPU, and our modules are imported anew to find it."""
    gpu = FakeGpu()

    def empty(size: int, *, device: torch.device | None = None, pin_memory: bool = False, **options: Any) -> Any:
        # What nobody draws into would be garbage, which must not decide about a test.
        return _zeros(size, **options) if device is None else gpu.allocate(size)

    def zeros(*size: int, pin_memory: bool = False, **options: Any) -> Any:
        return _zeros(*size, **options)

    def cdll(path: str) -> _NvJpeg:
        return _NvJpeg(gpu)

    with (
        patch.dict(sys.modules, _packages(gpu)),
        patch.multiple(torch, empty=empty, zeros=zeros),
        patch.multiple(
            torch.cuda,
            Stream=lambda device: SimpleNamespace(cuda_stream=1),
            current_stream=lambda device: gpu,
            empty_cache=gpu.empty_cache,
            get_device_capability=lambda device: (9, 0),
            set_device=lambda device: None,
            stream=lambda stream: contextlib.nullcontext(),
            synchronize=lambda device: gpu.synchronize(),
        ),
        patch.object(ctypes, "CDLL", cdll),
    ):
        for name in USERS:
            sys.modules.pop(name, None)
        yield gpu
