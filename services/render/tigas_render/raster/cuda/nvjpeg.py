"""JPEG on the GPU: the few functions of NVIDIA's nvJPEG library that an encoder needs, through ctypes.

The library comes from the wheel nvidia-nvjpeg (or a CUDA toolkit). Called directly it took 0.13 ms for a picture
of 1280 × 720, 0.05 ms less than through torchvision or nvImageCodec (docs/gpu.md).
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_int, c_size_t, c_void_p

from cuda.pathfinder import load_nvidia_dynamic_lib

CSS_420 = 2
"""nvjpegChromaSubsampling_t: one chroma sample for four pixels."""


ALLOCATOR_FAILURE = 5
"""nvjpegStatus_t: no memory."""


class NvJpegError(RuntimeError):
    """A call failed, with nvjpegStatus_t."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(f"{function} failed with status {status}")
        self.status = status


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


class JpegEncoder:
    """Encodes one picture at a time on one stream."""

    def __init__(self, library: NvJpeg, stream: int) -> None:
        self._library = library
        self._stream = c_void_p(stream)
        self._state, self._params = c_void_p(), c_void_p()
        self._planes = _Planes()
        self._quality = 0
        library.call("nvjpegEncoderStateCreate", library.handle, byref(self._state), self._stream)
        library.call("nvjpegEncoderParamsCreate", library.handle, byref(self._params), self._stream)
        library.call("nvjpegEncoderParamsSetSamplingFactors", self._params, CSS_420, self._stream)
        library.call("nvjpegEncoderParamsSetOptimizedHuffman", self._params, 0, self._stream)

    def close(self) -> None:
        """Give the library's memory back."""
        self._library.call("nvjpegEncoderParamsDestroy", self._params)
        self._library.call("nvjpegEncoderStateDestroy", self._state)

    def bound(self, width: int, height: int) -> int:
        """Bytes that the JPEG of a picture of this size cannot exceed."""
        size = c_size_t()
        self._library.call("nvjpegEncodeGetBufferSize", self._library.handle, self._params, width, height, byref(size))
        return size.value

    def encode(self, planes: int, width: int, height: int, quality: int) -> None:
        """Queue the encoding of planes in device memory: Y [H, W], Cb and Cr [⌈H/2⌉, ⌈W/2⌉], one after the other."""
        library = self._library
        if quality != self._quality:
            library.call("nvjpegEncoderParamsSetQuality", self._params, quality, self._stream)
            self._quality = quality
        columns, rows = (width + 1) // 2, (height + 1) // 2
        chroma = planes + width * height
        self._planes.channel[:3] = [planes, chroma, chroma + columns * rows]
        self._planes.pitch[:3] = [width, columns, columns]
        library.call(
            "nvjpegEncodeYUV", library.handle, self._state, self._params, byref(self._planes), CSS_420,
            width, height, self._stream,
        )  # fmt: skip

    def retrieve(self, into: int, room: int) -> int:
        """Queue the copy of the encoded picture to `room` bytes of pinned memory, and give its length.

        Waits until the picture is encoded; the bytes are there once the stream has been synchronised.
        """
        length = c_size_t(room)
        self._library.call(
            "nvjpegEncodeRetrieveBitstream", self._library.handle, self._state, c_void_p(into), byref(length),
            self._stream,
        )  # fmt: skip
        return length.value
