"""Sequences of C calls made without the GIL, and threads that make them. An eventfd starts each thread, and another
reports to the event loop.

A ctypes call releases the GIL and has to reacquire it. With a busy event loop that took 0.1 to 0.7 ms per call, most of
a frame's time (docs/results/2026-11-gpu.md); a sequence releases it once.

Ordinary Python threads are too slow for the goal of 100 viewers, 3,000 frames/s, on one GPU with 16 cores. The event
loop computes for 243 to 269 µs per frame (H200, 8 and 6 edges), 73 to 81 % of the time at that rate, mostly with the
GIL. A thread with one call each for launches, encoding and readback acquires the GIL five times per frame, including
its queue and its report; at an assumed 10 µs each, the share becomes 88 to 96 %, without the cost of the hand-overs.
On H200, threads with only two of them served 72 viewers, but 83 % of the frames of 90. With an engine alone, synthetic
frames and 3,000 requests/s on two busy cores, native threads lost nothing in three runs (p95 2, 3 and 91 ms); Python
threads with the same prepared calls lost 0, 43 and 70 % (p95 33 to 1,629 ms).
"""

# mypy: disable-error-code="no-untyped-call, call-arg, var-annotated"
from __future__ import annotations

import ctypes
import itertools
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

MOST_ARGUMENTS: Final = 11
MOST_CALLS: Final = 24
"""The limit of calls in one order."""

_libc = ctypes.CDLL(None)
_ROWS, _FAILED, _STATUS, _IS_LAST = range(4)


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


class NativeThreads:
    """Threads that each execute one order of calls at a time. The object itself belongs to a single thread."""

    def __init__(self, count: int, enter: Callable[[], None]) -> None:
        """count: at most 63; enter: called first in each thread, must not raise."""
        self._calls: list[tuple[Calls, ...]] = [()] * count
        self._tables = np.zeros((count, MOST_CALLS, 1 + MOST_ARGUMENTS), np.int64)
        self._states = np.zeros((count, 4), np.int64)
        self._orders = [os.eventfd(0, os.EFD_CLOEXEC) for _ in range(count)]
        self._done = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._threads = [
            threading.Thread(target=self._run, args=(number, enter), name=f"native {number}", daemon=True)
            for number in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def fileno(self) -> int:
        """A descriptor that is readable after a thread has finished, until `ended` is called."""
        return self._done

    def begin(self, thread: int, *calls: Calls) -> None:
        """Make an idle thread execute calls in order, until one fails. Raises RuntimeError after `end`."""
        row = 0
        table, state = self._tables[thread], self._states[thread]
        if state[_IS_LAST]:
            raise RuntimeError("the threads have ended")
        for some in calls:
            table[row : row + len(some.table)] = some.table
            row += len(some.table)
        self._calls[thread] = calls
        state[_ROWS] = row
        os.eventfd_write(self._orders[thread], 1)

    def ended(self) -> list[int]:
        """The threads that have finished since the last call."""
        try:
            bits = os.eventfd_read(self._done)
        except BlockingIOError:
            return []
        return [thread for thread in range(len(self._threads)) if bits >> thread & 1]

    def check(self, thread: int) -> None:
        """Raise the error of the thread's last order, if one of its calls failed."""
        failed, status = int(self._states[thread, _FAILED]), int(self._states[thread, _STATUS])
        if status:
            for some in self._calls[thread]:
                if failed < len(some.table):
                    raise some.error(failed, status)
                failed -= len(some.table)

    def end(self) -> None:
        """Wait until the threads have finished their orders and exited. `ended` still reports these."""
        self._states[:, _IS_LAST] = 1
        for order in self._orders:
            os.eventfd_write(order, 1)
        for started in self._threads:
            started.join()

    def close(self) -> None:
        """Close the descriptors, after `end`."""
        for descriptor in (*self._orders, self._done):
            os.close(descriptor)

    def _run(self, number: int, enter: Callable[[], None]) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # none interrupts a call
        enter()
        _serve(
            _address(_libc.read), _address(_libc.write), self._orders[number], self._done, 1 << number,
            np.zeros(1, np.int64), self._tables[number], self._states[number],
        )  # fmt: skip


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@njit("void(int64, int64, int64, int64, int64, int64[::1], int64[:, ::1], int64[::1])", nogil=True, cache=True)
def _serve(read, write, orders, done, bit, counter, table, state):  # type: ignore[no-untyped-def]
    at = counter.ctypes.data
    while True:
        call_c(read, (orders, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        rows = state[_ROWS]
        if rows:
            state[_ROWS] = 0
            state[_FAILED], state[_STATUS] = make_calls(table[:rows])
            # From here on the state may hold the next order. The counter adds up the bits of finished threads until it
            # is read; the system calls order the memory accesses of both sides.
            counter[0] = bit
            call_c(write, (done, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        if state[_IS_LAST]:
            return


class Stopwatch:
    """Measures the time between C calls by further calls."""

    def __init__(self, readings: int) -> None:
        self._times = np.zeros((readings, 2), np.int64)
        """Seconds and nanoseconds: struct timespec."""
        self.readings = tuple(
            Calls(Call(_libc.clock_gettime, (time.CLOCK_MONOTONIC, row.ctypes.data))) for row in self._times
        )
        """Calls that record the current time."""

    def seconds(self) -> list[float]:
        """Seconds from each reading to the next."""
        times = [seconds + 1e-9 * nanoseconds for seconds, nanoseconds in self._times.tolist()]
        return [later - earlier for earlier, later in itertools.pairwise(times)]
