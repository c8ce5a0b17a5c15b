"""The functions of NVIDIA's driver and of nvJPEG that frames need, through ctypes.

nvJPEG comes with the wheel nvidia-nvjpeg (or a CUDA toolkit). Calling it directly took 0.13 ms for an image of
1280 × 720, 0.05 ms less than through torchvision or nvImageCodec.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, addressof, byref, c_int, c_size_t, c_void_p
from functools import cache
from typing import Any

from cuda.bindings import driver
from cuda.pathfinder import load_nvidia_dynamic_lib

from tigas_render.raster.calls import Call, CallError

DRIVER = "libcuda.so.1"
BLOCKING_SYNC = 4
"""CU_CTX_SCHED_BLOCKING_SYNC."""
CSS_420, CSS_GRAY = 2, 6
"""nvjpegChromaSubsampling_t: one chroma sample for four pixels, and no chroma."""
ALLOCATOR_FAILURE = 5
"""nvjpegStatus_t: out of memory."""


class DriverError(CallError):
    """A failed driver call. The status is a CUresult."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(function, status)
        self.args = (f"{function} failed: {driver.CUresult(status).name}",)


def wait_asleep(index: int) -> None:
    """Let threads sleep while they wait for a device. Call it before anything else uses the device.

    By default threads spin, which takes processors away from the threads that serve viewers. Contexts that exist
    already may not be affected.
    """
    library = ctypes.CDLL(DRIVER)
    library.cuInit(0)
    library.cuDevicePrimaryCtxSetFlags_v2(index, BLOCKING_SYNC)


def driver_call(name: str, *arguments: int) -> Call:
    """Prepare a call of a driver function."""
    return Call(_driver_function(name), arguments, DriverError)


@cache
def _driver_function(name: str) -> Any:
    return getattr(ctypes.CDLL(DRIVER), name)


class NvJpegError(CallError):
    """A failed nvJPEG call. The status is an nvjpegStatus_t."""


class _Planes(ctypes.Structure):
    """nvjpegImage_t."""

    _fields_ = (("channel", c_void_p * 4), ("pitch", c_size_t * 4))


_FUNCTIONS: dict[str, tuple[type, ...]] = {
    "nvjpegCreateSimple": (POINTER(c_void_p),),
    "nvjpegEncoderStateCreate": (c_void_p, POINTER(c_void_p), c_void_p),
    "nvjpegEncoderStateDestroy": (c_void_p,),
    "nvjpegEncoderParamsCreate": (c_void_p, POINTER(c_void_p), c_void_p),
    "nvjpegEncoderParamsDestroy": (c_void_p,),
    "nvjpegEncoderParamsSetQuality": (c_void_p, c_int, c_void_p),
    "nvjpegEncoderParamsSetOptimizedHuffman": (c_void_p, c_int, c_void_p),
    "nvjpegEncoderParamsSetSamplingFactors": (c_void_p, c_int, c_void_p),
    "nvjpegEncodeGetBufferSize": (c_void_p, c_void_p, c_int, c_int, POINTER(c_size_t)),
    "nvjpegEncodeYUV": (c_void_p, c_void_p, c_void_p, POINTER(_Planes), c_int, c_int, c_int, c_void_p),
    "nvjpegEncodeRetrieveBitstream": (c_void_p, c_void_p, c_void_p, POINTER(c_size_t), c_void_p),
}


class NvJpeg:
    """The nvJPEG library, with a handle for the device that is current when it is created. Thread-safe."""

    def __init__(self) -> None:
        path = load_nvidia_dynamic_lib("nvjpeg").abs_path
        self._library = ctypes.CDLL(path)
        for name, arguments in _FUNCTIONS.items():
            getattr(self._library, name).argtypes = arguments
        self.handle = c_void_p()
        self.call("nvjpegCreateSimple", byref(self.handle))

    def call(self, name: str, *arguments: object) -> None:
        """Call a function. Raises NvJpegError on failure."""
        status = getattr(self._library, name)(*arguments)
        if status:
            raise NvJpegError(name, status)

    def prepared(self, name: str, *arguments: int, kept: object = None) -> Call:
        """Prepare a call. kept: the owner of memory that an argument points to."""
        return Call(getattr(self._library, name), arguments, NvJpegError, kept)


class JpegEncoder:
    """Encodes one image at a time on one stream."""

    def __init__(self, library: NvJpeg, stream: int, synchronize: Call, *, gray: bool = False) -> None:
        """synchronize: waits for the stream. gray: whether images are small and have no chroma, and get optimised
        Huffman tables.
        """
        self._library = library
        self._stream = c_void_p(stream)
        chroma = CSS_GRAY if gray else CSS_420
        self._state, self._params = c_void_p(), c_void_p()
        self._chroma = chroma
        self.length = c_size_t()
        """Size in bytes of the last JPEG, or before `fetching`, of the memory for it."""
        self._bound, self._bound_of = c_size_t(), (0, 0)
        library.call("nvjpegEncoderStateCreate", library.handle, byref(self._state), self._stream)
        library.call("nvjpegEncoderParamsCreate", library.handle, byref(self._params), self._stream)
        library.call("nvjpegEncoderParamsSetSamplingFactors", self._params, chroma, self._stream)
        library.call("nvjpegEncoderParamsSetOptimizedHuffman", self._params, int(gray), self._stream)
        self._wait = synchronize

    def close(self) -> None:
        """Release the library's memory."""
        self._library.call("nvjpegEncoderParamsDestroy", self._params)
        self._library.call("nvjpegEncoderStateDestroy", self._state)

    def bound(self, width: int, height: int) -> int:
        """Maximum size in bytes of the JPEG of an image of this size."""
        if (width, height) != self._bound_of:
            library, size = self._library, self._bound
            library.call("nvjpegEncodeGetBufferSize", library.handle, self._params, width, height, byref(size))
            self._bound_of = width, height
        return self._bound.value

    def encoding(self, planes: int, width: int, height: int, quality: int) -> tuple[Call, ...]:
        """Calls that encode planes in device memory.

        planes: address of Y [H, W], Cb and Cr [⌈H/2⌉, ⌈W/2⌉], one after the other.
        """
        columns, rows = (width + 1) // 2, (height + 1) // 2
        chroma = planes + width * height  # not read for gray images
        image = _Planes()
        image.channel[:3] = [planes, chroma, chroma + columns * rows]
        image.pitch[:3] = [width, columns, columns]
        handle, state, params = (each.value or 0 for each in (self._library.handle, self._state, self._params))
        stream = self._stream.value or 0
        arguments = handle, state, params, addressof(image), self._chroma, width, height, stream
        return (
            self._library.prepared("nvjpegEncoderParamsSetQuality", params, quality, stream),
            self._library.prepared("nvjpegEncodeYUV", *arguments, kept=image),
        )

    def fetching(self, into: int) -> tuple[Call, ...]:
        """Calls that copy the last JPEG to `length` bytes of pinned memory, wait, and set `length` to its size."""
        handle, state, stream = (each.value or 0 for each in (self._library.handle, self._state, self._stream))
        length = addressof(self.length)
        retrieve = self._library.prepared("nvjpegEncodeRetrieveBitstream", handle, state, into, length, stream)
        return retrieve, self._wait
