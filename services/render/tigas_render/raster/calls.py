"""C functions that are called one after the other without the interpreter's lock.

A thread that calls into C gives the lock away, and has to get it back after every single call. Where the event loop
computes, that took 0.1 to 0.7 ms a call and most of a frame's time (docs/gpu.md).
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
    """A C function's status was not 0."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(f"{function} failed with status {status}")
        self.status = status


@dataclass(frozen=True, slots=True)
class Call:
    """A function whose arguments are integers and pointers, at most MOST_ARGUMENTS, and whose result is an `int`."""

    function: Any
    """Of ctypes."""
    arguments: tuple[int, ...]
    error: type[CallError] = CallError
    """What is raised if it fails."""


class Calls:
    """Calls that are prepared once, so that making them costs one entry into C."""

    def __init__(self, *calls: Call) -> None:
        self._calls = calls  # keeps the functions
        self.table = np.zeros((len(calls), 1 + MOST_ARGUMENTS), np.int64)
        """A row for each: the function's address, and its arguments. What `make_calls` takes."""
        for row, call in zip(self.table, calls, strict=True):
            address = ctypes.cast(call.function, ctypes.c_void_p).value
            row[: 1 + len(call.arguments)] = [address or 0, *call.arguments]

    def replace(self, call: int, argument: int, *values: int) -> None:
        """Give a call other arguments, from one of them on. Both count from 0."""
        self.table[call, 1 + argument : 1 + argument + len(values)] = values

    def make(self) -> None:
        """Make the calls. The first that fails is the last; raises its error."""
        failed, status = make_calls(self.table)
        if status:
            raise self.error(failed, status)

    def error(self, failed: int, status: int) -> CallError:
        """What to raise for a call, counted from 0, that gave a status."""
        call = self._calls[failed]
        return call.error(call.function.__name__, status)


@intrinsic
def call_c(typing: Any, address: Any, arguments: Any) -> Any:
    """Calls a C function. On x86-64 and ARM64 each integer takes 64 bits, of which the function looks at its own."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function, packed = values
        integer = ir.IntType(64)
        prototype = ir.FunctionType(ir.IntType(32), [integer] * MOST_ARGUMENTS)
        unpacked = [builder.extract_value(packed, place) for place in range(MOST_ARGUMENTS)]
        return builder.call(builder.inttoptr(function, prototype.as_pointer()), unpacked)

    return types.int32(types.int64, types.UniTuple(types.int64, MOST_ARGUMENTS)), generate


@njit("UniTuple(int64, 2)(int64[:, ::1])", nogil=True, cache=True)
def make_calls(calls: Any) -> Any:
    """Makes the calls of a table; the row of the first that fails, and its status, or -1 and 0. For compiled code."""
    for index in range(len(calls)):
        a = calls[index]
        status = call_c(a[0], (a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11]))
        if status != 0:
            return index, status
    return -1, 0
