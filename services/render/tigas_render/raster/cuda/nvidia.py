"""The few functions of NVIDIA's driver and of nvJPEG that frames need, through ctypes.

nvJPEG comes from the wheel nvidia-nvjpeg (or a CUDA toolkit). Called directly it took 0.13 ms for a picture of
1280 × 720, 0.05 ms less than through torchvision or nvImageCodec.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, addressof, byref, c_int, c_size_t, c_void_p

from cuda.bindings import driver
from cuda.pathfinder import load_nvidia_dynamic_lib

from tigas_render.raster.calls import Call, CallError, Calls

DRIVER = "libcuda.so.1"
CSS_420, CSS_GRAY = 2, 6
"""nvjpegChromaSubsampling_t: one chroma sample for four pixels, and none."""
ALLOCATOR_FAILURE = 5
"""nvjpegStatus_t: no memory."""


class DriverError(CallError):
    """A call failed, with CUresult."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(function, status)
        self.args = (f"{function} failed: {driver.CUresult(status).name}",)


def driver_call(name: str, *arguments: int) -> Call:
    """A call for later."""
    return Call(getattr(ctypes.CDLL(DRIVER), name), arguments, DriverError)


class NvJpegError(CallError):
    """A call failed, with nvjpegStatus_t."""


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
    """The library, with a handle for the device that is current when it is made. Safe to use from any thread."""

    def __init__(self) -> None:
        path = load_nvidia_dynamic_lib("nvjpeg").abs_path
        self._library = ctypes.CDLL(path)
        for name, arguments in _FUNCTIONS.items():
            getattr(self._library, name).argtypes = arguments
        self.handle = c_void_p()
        self.call("nvjpegCreateSimple", byref(self.handle))

    def call(self, name: str, *arguments: object) -> None:
        """Call a function. Raises NvJpegError unless it succeeds."""
        status = getattr(self._library, name)(*arguments)
        if status:
            raise NvJpegError(name, status)

    def prepared(self, name: str, *arguments: int) -> Call:
        """A call for later."""
        return Call(getattr(self._library, name), arguments, NvJpegError)


class JpegEncoder:
    """Encodes one picture at a time on one stream."""

    def __init__(self, library: NvJpeg, stream: int, synchronize: Call, *, gray: bool = False) -> None:
        """synchronize: waits for the stream; gray: pictures have no chroma, and are small, so that they get Huffman
        tables of their own.
        """
        self._library = library
        self._stream = c_void_p(stream)
        chroma = CSS_GRAY if gray else CSS_420
        self._state, self._params = c_void_p(), c_void_p()
        self._planes = _Planes()
        self.length = c_size_t()
        """Of the last JPEG, in bytes."""
        self._bound, self._bound_of = c_size_t(), (0, 0)
        library.call("nvjpegEncoderStateCreate", library.handle, byref(self._state), self._stream)
        library.call("nvjpegEncoderParamsCreate", library.handle, byref(self._params), self._stream)
        library.call("nvjpegEncoderParamsSetSamplingFactors", self._params, chroma, self._stream)
        library.call("nvjpegEncoderParamsSetOptimizedHuffman", self._params, int(gray), self._stream)
        handle, state, params = (pointer.value or 0 for pointer in (library.handle, self._state, self._params))
        planes, length = addressof(self._planes), addressof(self.length)
        self._encode = Calls(
            library.prepared("nvjpegEncoderParamsSetQuality", params, 0, stream),
            library.prepared("nvjpegEncodeYUV", handle, state, params, planes, chroma, 0, 0, stream),
        )
        self._fetch = Calls(
            library.prepared("nvjpegEncodeRetrieveBitstream", handle, state, 0, length, stream), synchronize
        )

    def close(self) -> None:
        """Give the library's memory back."""
        self._library.call("nvjpegEncoderParamsDestroy", self._params)
        self._library.call("nvjpegEncoderStateDestroy", self._state)

    def bound(self, width: int, height: int) -> int:
        """Bytes that the JPEG of a picture of this size cannot exceed."""
        if (width, height) != self._bound_of:
            library, size = self._library, self._bound
            library.call("nvjpegEncodeGetBufferSize", library.handle, self._params, width, height, byref(size))
            self._bound_of = width, height
        return self._bound.value

    def encoding(self, planes: int, width: int, height: int, quality: int, into: int, room: int) -> tuple[Calls, Calls]:
        """Two calls: one encodes planes in device memory; the other copies the result to `room` bytes of pinned memory,
        and waits.

        Planes: Y [H, W], Cb and Cr [⌈H/2⌉, ⌈W/2⌉], one after the other. The JPEG's size is in `length`
        afterwards.
        """
        columns, rows = (width + 1) // 2, (height + 1) // 2
        chroma = planes + width * height  # not read if there is none
        self._planes.channel[:3] = [planes, chroma, chroma + columns * rows]
        self._planes.pitch[:3] = [width, columns, columns]
        self.length.value = room
        self._encode.replace(0, 1, quality)
        self._encode.replace(1, 5, width, height)
        self._fetch.replace(0, 2, into)
        return self._encode, self._fetch
