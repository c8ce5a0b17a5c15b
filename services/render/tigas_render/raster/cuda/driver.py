"""The functions of NVIDIA's driver that every frame calls."""

from __future__ import annotations

import ctypes

from cuda.bindings import driver

from tigas_render.raster.calls import Call, CallError

LIBRARY = "libcuda.so.1"


class DriverError(CallError):
    """A call failed, with CUresult."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(function, status)
        self.args = (f"{function} failed: {driver.CUresult(status).name}",)


def driver_call(name: str, *arguments: int) -> Call:
    """A call for later."""
    return Call(getattr(ctypes.CDLL(LIBRARY), name), arguments, DriverError)
