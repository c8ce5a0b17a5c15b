"""Number of streams that a client may open: enough for a viewer to send a request at any time, and not hundreds.

A stream counts from its first packet until both sides have finished it and the client has acknowledged the whole
answer; the next MAX_STREAMS takes as long again to arrive, and is delayed until half of the credit is used, to be worth
a frame. That makes three round trips, plus the server's time and a delayed acknowledgement.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from aioquic.quic.connection import Limit

RATE = 120.0
"""Requests a second of a viewer with a fast display."""
SERVICE_S = 0.1
"""Until a request is answered, and the client acknowledges that, in seconds."""
LEAST, MOST = 16, 128


def stream_window(round_trip_s: float) -> int:
    """Streams that a client may have open at a time."""
    return max(LEAST, min(MOST, math.ceil(RATE * (3 * round_trip_s + SERVICE_S))))


class StreamCredit(Limit):
    """aioquic's limit, which grows by one with each finished stream, and with the round trip. It never shrinks below
    the announced value.
    """

    def __init__(self, limit: Limit, round_trip_s: Callable[[], float]) -> None:
        """limit: aioquic's own, which this replaces."""
        self.frame_type, self.name = limit.frame_type, limit.name
        self.used = self._finished = 0
        self._round_trip_s = round_trip_s
        self.sent = stream_window(0.0)

    @property
    def value(self) -> int:
        """How many streams the client may have opened in all."""
        return max(self.sent, self._finished + stream_window(self._round_trip_s()))

    @value.setter
    def value(self, value: int) -> None:
        self._finished += value - self.value
