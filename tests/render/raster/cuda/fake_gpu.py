"""A GPU that draws nothing but runs out of memory, fails and is lost like a real one.

It replaces the CUDA rasteriser's external dependencies: PyTorch's allocator and streams, the driver, cuda.core and
nvJPEG's library. Its memory is the host's.
"""

from __future__ import annotations

import contextlib
import ctypes
import struct
import sys
import weakref
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import torch

from tigas_render.raster import lanes  # noqa: F401 - with Numba, before modules are replaced
from tigas_render.raster.cuda.parameters import SIZE

USERS = tuple(f"tigas_render.raster.cuda.{name}" for name in ("nvidia", "rasterizer", "workspace"))
"""Our modules that import the replaced ones."""
STATUS = 8 * 20
"""Where in a frame's parameters the address is at which it leaves the entries and chunks that it needed."""


class CUDAError(Exception):
    """cuda.core's."""


class FakeGpu:
    """Counts its memory in bytes. A test sets the faults."""

    def __init__(self) -> None:
        self.capacity = 1 << 40
        self.allocated = 0
        """Memory of tensors."""
        self.cached = 0
        """Memory cached by PyTorch after tensors were freed."""
        self.entries, self.chunks = 1000, 1
        """What a frame needs: entries of its lists, and chunks of Gaussians."""
        self.frames = 0
        """How many were drawn."""
        self.encoders = 0
        """JPEG encoders: a workspace has two."""
        self.launch_result = "CUDA_SUCCESS"
        self.sync_result = "CUDA_SUCCESS"
        self.copy_result = "CUDA_SUCCESS"
        self.jpeg_status = 0
        self.lost = False
        """Whether every call fails."""
        self._parameters = 0

    # -- memory ------------------------------------------------------------------------------------------------------

    def allocate(self, size: int) -> torch.Tensor:
        """Device memory. PyTorch frees its cache before it reports an out-of-memory error."""
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
        """Return PyTorch's cache to the driver."""
        self.cached = 0

    # -- work --------------------------------------------------------------------------------------------------------

    def launch_first_kernel(self, *arguments: int) -> int:
        """cuLaunchKernel: the first argument of the kernel is the frame's parameters."""
        self._parameters = ctypes.c_void_p.from_address(arguments[9]).value or 0
        return CURESULTS.index(self.launch_result)

    def launch_graph(self, *_: int) -> int:
        """cuGraphLaunch."""
        self.draw()
        return 0

    def wait(self, *_: int) -> int:
        """cuStreamSynchronize."""
        return CURESULTS.index("CUDA_ERROR_ILLEGAL_ADDRESS" if self.lost else self.sync_result)

    def encode(self, *_: int) -> int:
        """nvjpegEncodeYUV."""
        return self.jpeg_status

    def retrieve(self, *arguments: int) -> int:
        """nvjpegEncodeRetrieveBitstream."""
        ctypes.c_size_t.from_address(arguments[3]).value = 10
        return 0

    def copy(self, *_: int) -> int:
        """cuMemcpyDtoHAsync."""
        return CURESULTS.index(self.copy_result)

    def draw(self) -> None:
        """The kernels of a frame after the first."""
        (status,) = struct.unpack_from("=Q", (ctypes.c_char * SIZE).from_address(self._parameters), STATUS)
        (ctypes.c_uint32 * 2).from_address(status)[:] = [self.entries, self.chunks]
        self.frames += 1

    def synchronize(self) -> None:
        """Wait for the device."""
        if self.lost:
            raise RuntimeError("CUDA error: an illegal memory access was encountered\nMore follows.")


CURESULTS = ["CUDA_SUCCESS", "CUDA_ERROR_OUT_OF_MEMORY", "CUDA_ERROR_ILLEGAL_ADDRESS"]
_zeros = torch.zeros


FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int64] * 11)
"""A function called by its address."""


class _Library:
    """Of ctypes: every function gives a status."""

    def __init__(self, gpu: FakeGpu) -> None:
        self._gpu = gpu
        self._prepared: dict[str, Callable[..., int]] = {
            "cuLaunchKernel": gpu.launch_first_kernel,
            "cuGraphLaunch": gpu.launch_graph,
            "cuMemcpyDtoHAsync_v2": gpu.copy,
            "cuStreamSynchronize": gpu.wait,
            "nvjpegEncoderParamsSetQuality": lambda *_: 0,
            "nvjpegEncodeYUV": gpu.encode,
            "nvjpegEncodeRetrieveBitstream": gpu.retrieve,
        }

    def __getattr__(self, name: str) -> Any:
        def function(*arguments: Any) -> int:
            if name == "nvjpegEncoderStateCreate":
                self._gpu.encoders += 1
            elif name == "nvjpegEncodeGetBufferSize":
                arguments[-1]._obj.value = 1000
            return 0

        found: Any = function
        if name in self._prepared:
            found = FUNCTION(self._prepared[name])
            found.__name__ = name
        setattr(self, name, found)
        return found


def _packages(gpu: FakeGpu) -> dict[str, ModuleType]:
    """The used parts of CUDA's packages."""

    def package(name: str, **members: Any) -> ModuleType:
        module = ModuleType(name)
        vars(module).update(members)
        return module

    kernel = SimpleNamespace(
        handle=1, occupancy=SimpleNamespace(max_active_blocks_per_multiprocessor=lambda threads, shared: 1)
    )
    builder = SimpleNamespace(
        begin_building=lambda mode: None,
        end_building=lambda: SimpleNamespace(complete=lambda: SimpleNamespace(handle=1)),
    )
    stream = SimpleNamespace(handle=1, create_graph_builder=lambda: builder)
    driver = SimpleNamespace(CUresult=lambda status: SimpleNamespace(name=CURESULTS[status]))
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
        # Undrawn pixels would be garbage, which must not decide a test.
        return _zeros(size, **options) if device is None else gpu.allocate(size)

    def zeros(*size: int, pin_memory: bool = False, **options: Any) -> Any:
        return _zeros(*size, **options)

    library = _Library(gpu)

    with (
        patch.dict(sys.modules, _packages(gpu)),
        patch.multiple(torch, empty=empty, zeros=zeros),
        patch.multiple(
            torch.cuda,
            Stream=lambda device: SimpleNamespace(cuda_stream=1),
            current_stream=lambda device: gpu,
            empty_cache=gpu.empty_cache,
            get_device_capability=lambda device: (9, 0),
            get_device_properties=lambda device: SimpleNamespace(total_memory=12 << 30),
            set_device=lambda device: None,
            synchronize=lambda device: gpu.synchronize(),
        ),
        patch.object(ctypes, "CDLL", lambda path: library),
    ):
        for name in USERS:
            sys.modules.pop(name, None)
        yield gpu
