"""Threads that make C calls and never need the interpreter's lock, from when they are told to until they are done.

A Python thread that waits for a device takes the lock from the event loop for every frame, and each time it changes
hands a processor has to wake up (docs/gpu.md). These hear of their calls by an eventfd, and tell by one that an event
loop watches.
"""

# mypy: disable-error-code="no-untyped-call, call-arg"
from __future__ import annotations

import ctypes
import itertools
import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numba import njit

from tigas_render.raster.calls import MOST_ARGUMENTS, Call, Calls, call_c, make_calls

MOST_CALLS: Final = 24
"""That a thread makes in one go."""

_libc = ctypes.CDLL(None)
_ROWS, _IS_DONE, _FAILED, _STATUS, _IS_LAST = range(5)


class NativeThreads:
    """So many threads, of which each makes calls for one at a time. All but the threads belongs to one thread."""

    def __init__(self, count: int, enter: Callable[[], None]) -> None:
        """enter: called once in each thread, before anything else; it must not fail."""
        self._calls: list[tuple[Calls, ...]] = [()] * count
        self._tables = np.zeros((count, MOST_CALLS, 1 + MOST_ARGUMENTS), np.int64)
        self._states = np.zeros((count, 5), np.int64)
        self._busy: set[int] = set()
        self._orders = [os.eventfd(0, os.EFD_CLOEXEC) for _ in range(count)]
        self._done = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._threads = [
            threading.Thread(target=self._run, args=(number, enter), name=f"native {number}", daemon=True)
            for number in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def fileno(self) -> int:
        """Readable once a thread is done, until `ended`."""
        return self._done

    def begin(self, thread: int, *calls: Calls) -> None:
        """Have an idle thread make calls, in order, until one fails. Raises RuntimeError after `end`."""
        row = 0
        table, state = self._tables[thread], self._states[thread]
        if state[_IS_LAST]:
            raise RuntimeError("the threads have ended")
        for some in calls:
            table[row : row + len(some.table)] = some.table
            row += len(some.table)
        self._calls[thread] = calls
        state[_ROWS], state[_IS_DONE] = row, 0
        self._busy.add(thread)
        os.eventfd_write(self._orders[thread], 1)

    def ended(self) -> list[int]:
        """The threads that are done since this was called last."""
        try:
            os.eventfd_read(self._done)
        except BlockingIOError:
            return []
        ended = [thread for thread in self._busy if self._states[thread, _IS_DONE]]
        self._busy.difference_update(ended)
        return ended

    def check(self, thread: int) -> None:
        """Raises the error of the call that failed, if one has, among those that the thread made last."""
        failed, status = int(self._states[thread, _FAILED]), int(self._states[thread, _STATUS])
        if status:
            for some in self._calls[thread]:
                if failed < len(some.table):
                    raise some.error(failed, status)
                failed -= len(some.table)

    def end(self) -> None:
        """Have the threads make what they have begun, and end; wait for that. `ended` still tells of it."""
        self._states[:, _IS_LAST] = 1
        for order in self._orders:
            os.eventfd_write(order, 1)
        for started in self._threads:
            started.join()

    def close(self) -> None:
        """Once the threads have ended."""
        for descriptor in (*self._orders, self._done):
            os.close(descriptor)

    def _run(self, number: int, enter: Callable[[], None]) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())  # none interrupts a call
        enter()
        _serve(
            _address(_libc.read), _address(_libc.write), self._orders[number], self._done,
            np.zeros(1, np.int64), self._tables[number], self._states[number],
        )  # fmt: skip


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@njit("void(int64, int64, int64, int64, int64[::1], int64[:, ::1], int64[::1])", nogil=True, cache=True)
def _serve(read, write, orders, done, counter, table, state):  # type: ignore[no-untyped-def]
    at = counter.ctypes.data
    while True:
        call_c(read, (orders, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        if state[_ROWS]:
            state[_FAILED], state[_STATUS] = make_calls(table[: state[_ROWS]])
            state[_ROWS], state[_IS_DONE] = 0, 1
            counter[0] = 1
            call_c(write, (done, at, 8, 0, 0, 0, 0, 0, 0, 0, 0))
        if state[_IS_LAST]:
            return


class Stopwatch:
    """Takes the time between C calls, as calls of their own."""

    def __init__(self, readings: int) -> None:
        self._times = np.zeros((readings, 2), np.int64)
        """Seconds and nanoseconds: struct timespec."""
        self.readings = tuple(
            Calls(Call(_libc.clock_gettime, (time.CLOCK_MONOTONIC, row.ctypes.data))) for row in self._times
        )
        """Each takes the time when it is made."""

    def seconds(self) -> list[float]:
        """Between each reading and the next."""
        times = [seconds + 1e-9 * nanoseconds for seconds, nanoseconds in self._times.tolist()]
        return [later - earlier for earlier, later in itertools.pairwise(times)]
