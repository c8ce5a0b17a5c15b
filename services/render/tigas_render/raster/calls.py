"""Sequences of C calls made without the GIL.

A ctypes call releases the GIL and has to reacquire it. With a busy event loop that took 0.1 to 0.7 ms per call, most of
a frame's time (docs/results/2026-11-gpu.md); a sequence releases it once.
"""

# mypy: disable-error-code="no-untyped-call, call-arg, var-annotated"
from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

MOST_ARGUMENTS = 11


class CallError(RuntimeError):
    """A C function returned a status other than 0."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(f"{function} failed with status {status}")
        self.status = status


@dataclass(frozen=True, slots=True)
class Call:
    """A function of at most MOST_ARGUMENTS integers and pointers that returns an `int` status."""

    function: Any
    """A ctypes function."""
    arguments: tuple[int, ...]
    error: type[CallError] = CallError
    """The exception for a status other than 0."""


class Calls:
    """A prepared sequence of calls, made by a single entry into C."""

    def __init__(self, *calls: Call) -> None:
        self._calls = calls  # keeps the functions alive
        self.table = np.zeros((len(calls), 1 + MOST_ARGUMENTS), np.int64)
        """A row per call, the function's address and its arguments, for `make_calls`."""
        for row, call in zip(self.table, calls, strict=True):
            address = ctypes.cast(call.function, ctypes.c_void_p).value
            row[: 1 + len(call.arguments)] = [address or 0, *call.arguments]

    def replace(self, call: int, argument: int, *values: int) -> None:
        """Replace arguments of a call, starting at one of them; both count from 0."""
        self.table[call, 1 + argument : 1 + argument + len(values)] = values

    def make(self) -> None:
        """Make the calls up to the first failure, and raise its error."""
        failed, status = make_calls(self.table)
        if status:
            raise self.error(failed, status)

    def error(self, failed: int, status: int) -> CallError:
        """The exception for a failed call, counted from 0."""
        call = self._calls[failed]
        return call.error(call.function.__name__, status)


@intrinsic
def call_c(typing: Any, address: Any, arguments: Any) -> Any:
    """Call a C function. On x86-64 and ARM64 every argument takes 64 bits; the function reads its own part."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function, packed = values
        integer = ir.IntType(64)
        prototype = ir.FunctionType(ir.IntType(32), [integer] * MOST_ARGUMENTS)
        unpacked = [builder.extract_value(packed, place) for place in range(MOST_ARGUMENTS)]
        return builder.call(builder.inttoptr(function, prototype.as_pointer()), unpacked)

    return types.int32(types.int64, types.UniTuple(types.int64, MOST_ARGUMENTS)), generate


@njit("UniTuple(int64, 2)(int64[:, ::1])", nogil=True, cache=True)
def make_calls(calls: Any) -> Any:
    """Make the calls of a table: the row of the first failure and its status, or -1 and 0. For compiled code."""
    for index in range(len(calls)):
        a = calls[index]
        status = call_c(a[0], (a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11]))
        if status != 0:
            return index, status
    return -1, 0
