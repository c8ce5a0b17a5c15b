"""The kernel's timestamps become times of the monotonic clock, despite steps of the real-time clock."""

from __future__ import annotations

import socket
import struct

import pytest

from tigas_render.transport.arrival import SO_TIMESTAMPNS, arrival, stamp_ns

REAL = 1_800_000_000_000_000_000


@pytest.mark.parametrize(
    ("stamp", "arrived"),
    [
        (REAL - 2_300_000_000, 997.7),
        (REAL, 1000.0),
        (None, 1000.0),
        (REAL + 3_600_000_000_000, 1000.0),
        (REAL - 3_600_000_000_000, 990.0),
    ],
    ids=["it waited", "it did not", "no stamp", "the clock was set back", "the clock was set forward"],
)
def test_when_a_datagram_arrived(stamp: int | None, arrived: float) -> None:
    assert arrival(stamp, REAL, now=1000.0, empty_at=990.0) == pytest.approx(arrived)


def test_the_stamp_is_found_among_other_messages() -> None:
    stamp = (socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 12, 34))
    assert stamp_ns([(socket.IPPROTO_IP, 1, b"other"), stamp]) == 12_000_000_034
    assert stamp_ns([]) is None
