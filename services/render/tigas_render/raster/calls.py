"""Sequences of C calls made without the GIL.

A ctypes call releases the GIL and has to reacquire it. With a busy event loop that took 0.1 to 0.7 ms per call, most of
a frame's time (docs/results/2026-11-gpu.md). A sequence releases it only once.
"""

# mypy: disable-error-code="no-untyped-call, call-arg, var-annotated"
from __future__ import annotations

import ctypes
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

MAX_ARGUMENTS: Final = 11
MAX_CALLS: Final = 24
"""Maximum number of calls in one order to a thread."""
ROWS, FAILED, STATUS, IS_LAST = range(4)
"""State of a thread: the number of calls in a new order, the outcome of the last order, and whether to exit."""

_libc = ctypes.CDLL(None)


class CallError(RuntimeError):
    """A C function returned a status other than 0."""

    def __init__(self, function: str, status: int) -> None:
        super().__init__(f"{function} failed with status {status}")
        self.status = status


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a C function with at most MOST_ARGUMENTS integers and pointers that returns an `int` status."""

    function: Any
    """A ctypes function."""
    arguments: tuple[int, ...]
    error: type[CallError] = CallError
    """The exception for a status other than 0."""
    kept: object = None
    """The owner of memory that an argument points to, if nothing else keeps it alive."""


class Calls:
    """A prepared sequence of calls, made with a single entry into C."""

    def __init__(self, *calls: Call) -> None:
        self._calls = calls  # keeps the functions and their memory alive
        self.table = np.zeros((len(calls), 1 + MAX_ARGUMENTS), np.int64)
        """One row per call, with the function's address and arguments, for `make_calls`."""
        for row, call in zip(self.table, calls, strict=True):
            row[: 1 + len(call.arguments)] = [_address(call.function), *call.arguments]

    def make(self) -> None:
        """Make the calls up to the first failure, and raise its error."""
        failed, status = make_calls(self.table)
        if status:
            raise self.error(failed, status)

    def error(self, failed: int, status: int) -> CallError:
        """The exception for a failed call. failed: its index."""
        call = self._calls[failed]
        return call.error(call.function.__name__, status)


@intrinsic
def call_c(typing: Any, address: Any, arguments: Any) -> Any:
    """Call a C function. On x86-64 and ARM64 every argument takes 64 bits; the function reads as many as it needs."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function, packed = values
        integer = ir.IntType(64)
        prototype = ir.FunctionType(ir.IntType(32), [integer] * MAX_ARGUMENTS)
        unpacked = [builder.extract_value(packed, place) for place in range(MAX_ARGUMENTS)]
        return builder.call(builder.inttoptr(function, prototype.as_pointer()), unpacked)

    return types.int32(types.int64, types.UniTuple(types.int64, MAX_ARGUMENTS)), generate


@njit("UniTuple(int64, 2)(int64[:, ::1])", nogil=True, cache=True)
def make_calls(calls: Any) -> Any:
    """Make the calls of a table. Returns the row and status of the first failure, or -1 and 0. For compiled code."""
    for index in range(len(calls)):
        a = calls[index]
        status = call_c(a[0], (a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11]))
        if status != 0:
            return index, status
    return -1, 0


def serve(order: int, done: int, bit: int, table: Any, state: Any) -> None:
    """Execute orders on this thread. An order is the first state[ROWS] calls of a table, announced by an eventfd.

    After each order, `bit` is added to the eventfd `done`.
    """
    counter = np.zeros(1, np.int64)
    _serve(_address(_libc.read), _address(_libc.write), order, done, bit, counter, table, state)


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@njit("void(int64, int64, int64, int64, int64, int64[::1], int64[:, ::1], int64[::1])", nogil=True, cache=True)
def _serve(read, write, orders, done, bit, counter, table, state):  # type: ignore[no-untyped-def]
    at = counter.ctypes.data
    while True:
        call_c(read, (orders, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        rows = state[ROWS]
        if rows:
            state[ROWS] = 0
            state[FAILED], state[STATUS] = make_calls(table[:rows])
            # From here on the state may hold the next order. The eventfd adds up the bits of finished threads until it
            # is read. The system calls order the memory accesses of both sides.
            counter[0] = bit
            call_c(write, (done, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        if state[IS_LAST]:
            return


class FrameCalls(Calls):
    """The calls of a frame with clock readings in between, prepared once for many frames, which run one at a time."""

    def __init__(self, draw: Sequence[Call], fetch: Sequence[Call]) -> None:
        """draw: calls that draw the frame. fetch: calls that encode it, copy it to the host and wait."""
        self._times = np.zeros((3, 2), np.int64)
        """Seconds and nanoseconds (struct timespec) at the beginning, after drawing and at the end."""
        began, drawn, ended = (
            Call(_libc.clock_gettime, (time.CLOCK_MONOTONIC, row.ctypes.data)) for row in self._times
        )
        self.draw, self.fetch = tuple(draw), tuple(fetch)
        super().__init__(began, *self.draw, drawn, *self.fetch, ended)

    def seconds(self) -> tuple[float, float]:
        """Seconds that the last frame took to draw, and to encode and fetch."""
        (began, began_ns), (drawn, drawn_ns), (ended, ended_ns) = self._times.tolist()
        return drawn - began + 1e-9 * (drawn_ns - began_ns), ended - drawn + 1e-9 * (ended_ns - drawn_ns)
