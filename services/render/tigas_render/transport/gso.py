"""UDP segmentation offload: many datagrams of one size to one address in a single system call (Linux, udp(7)).

Sending dominates a Python QUIC server's time in the kernel; a call for each packet costs several times as much.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any

Address = tuple[Any, ...]
Datagram = tuple[bytes, Address]

SOL_UDP = 17
UDP_SEGMENT = 103
MAX_SEGMENTS = 40
"""Below the kernel's 64 (UDP_MAX_SEGMENTS of older kernels)."""
MAX_BATCH = 64_000
"""Bytes; a batch is one UDP payload to the kernel until it is cut into segments."""


def batches(datagrams: Sequence[Datagram]) -> Iterator[tuple[list[bytes], Address]]:
    """Group consecutive datagrams that may leave in one call: one address, one size, only the last may be shorter."""
    start = 0
    while start < len(datagrams):
        first, address = datagrams[start]
        size = total = len(first)
        stop = start + 1
        while stop < len(datagrams) and stop - start < MAX_SEGMENTS:
            data, to = datagrams[stop]
            if to != address or len(data) > size or total + len(data) > MAX_BATCH:
                break
            total += len(data)
            stop += 1
            if len(data) < size:
                break
        yield [data for data, _ in datagrams[start:stop]], address
        start = stop


def segment_size(batch: Sequence[bytes]) -> list[tuple[int, int, bytes]]:
    """The control message with the segment size of a batch."""
    return [(SOL_UDP, UDP_SEGMENT, struct.pack("=H", len(batch[0])))]
