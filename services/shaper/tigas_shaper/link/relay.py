"""Delay, jitter and loss for kernels without netem: a process that delays packets.

`python -m tigas_shaper.link.relay DEVICE` creates a TAP device. It reads and holds the packets that the kernel sends to
it, and writes them back, which the kernel treats as packets received by the device; filters of `link` and `delay` route
them there and back. The device disappears with the process, and the process ends when its standard input is closed, so
that nothing stays behind and no packet passes once the shaper has ended. It reads packed RelayStates from there.

One process per direction, using only the standard library, cannot be delayed by other work of the shaper.
"""

from __future__ import annotations

import os
import random
import select
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from fcntl import ioctl
from pathlib import Path

CLONE_DEVICE = Path("/dev/net/tun")
_TUNSETIFF = 0x400454CA
_IFF_TAP_NO_PI = 0x0002 | 0x1000
_LARGEST_FRAME = 65_536
_MAX_BATCH = 64
"""Number of packets to read before due ones are written."""
MAX_HELD_BYTES = 64 * 1024 * 1024
"""Maximum number of bytes held; more is lost. Two seconds at 250 Mbit/s."""


@dataclass(frozen=True, slots=True)
class RelayState:
    """Delay and jitter in seconds, and loss as a probability. When blocked, packets wait at their source."""

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    blocked: bool = False

    FORMAT = struct.Struct("=3d?")

    def pack(self) -> bytes:
        return self.FORMAT.pack(self.delay_s, self.jitter_s, self.loss, self.blocked)

    @classmethod
    def unpack(cls, data: bytes) -> RelayState:
        return cls(*cls.FORMAT.unpack(data))


class DelayLine:
    """Packets in transit, which leave in order regardless of jitter, as on a link.

    Each delay is uniform between delay − jitter and delay + jitter, as with netem; a packet may leave later because of
    an earlier one.
    """

    def __init__(self, uniform: Callable[[float, float], float]) -> None:
        self.state = RelayState()
        self._uniform = uniform
        self._packets: deque[tuple[float, bytes]] = deque()
        self._held = 0

    def push(self, packet: bytes, now: float) -> None:
        """Accept a packet, unless it is lost. `now` in seconds."""
        state = self.state
        if (state.loss and self._uniform(0.0, 1.0) < state.loss) or self._held + len(packet) > MAX_HELD_BYTES:
            return
        due = now + state.delay_s
        if state.jitter_s:
            due = max(now, due + self._uniform(-state.jitter_s, state.jitter_s))
        if self._packets:
            due = max(due, self._packets[-1][0])
        self._packets.append((due, packet))
        self._held += len(packet)

    def pop(self, now: float) -> bytes | None:
        """The next packet if it is due, or None."""
        if not self._packets or self._packets[0][0] > now:
            return None
        packet = self._packets.popleft()[1]
        self._held -= len(packet)
        return packet

    @property
    def next_due(self) -> float | None:
        """Time in seconds at which the next packet leaves, or None."""
        return self._packets[0][0] if self._packets else None


def open_tap(name: str) -> int:
    """Create a TAP device that exists while the returned descriptor is open. Raises OSError."""
    tap = os.open(CLONE_DEVICE, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        ioctl(tap, _TUNSETIFF, struct.pack("16sH22x", name.encode(), _IFF_TAP_NO_PI))
    except OSError:
        os.close(tap)
        raise
    return tap


def relay(tap: int, control: int) -> None:
    """Relay packets until `control` is closed. Raises OSError if the device fails."""
    line = DelayLine(random.uniform)
    os.set_blocking(control, False)
    while True:
        due = line.next_due
        wait = None if due is None else max(0.0, due - time.monotonic())
        ready, _, _ = select.select([control] if line.state.blocked else [control, tap], [], [], wait)
        if control in ready:
            data = os.read(control, RelayState.FORMAT.size)
            if not data:
                return
            line.state = RelayState.unpack(data)
        if tap in ready:
            with suppress(BlockingIOError):
                for _ in range(_MAX_BATCH):
                    line.push(os.read(tap, _LARGEST_FRAME), time.monotonic())
        while (packet := line.pop(time.monotonic())) is not None:
            with suppress(BlockingIOError):
                os.write(tap, packet)


def main() -> None:
    """Create the device, print `ready`, and relay."""
    with suppress(OSError):
        os.nice(-10)  # a link does not slow down because its machine is busy
    try:
        tap = open_tap(sys.argv[1])
        print("ready", flush=True)
        relay(tap, sys.stdin.fileno())
    except OSError as error:
        print(f"{CLONE_DEVICE}: {os.strerror(error.errno or 0)}", flush=True)
        sys.exit(1)


if __name__ == "__main__":
    main()
