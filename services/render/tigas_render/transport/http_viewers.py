"""Who views by `POST /render`: there is no session whose beginning could be refused, so it is told by the address."""

from __future__ import annotations

from collections.abc import Callable

from tigas_common.errors import ServerFull
from tigas_render.transport.load import FULL, Load

STAY_S = 30.0
"""Who has asked within so many seconds is in."""


class HttpViewers:
    """Keeps those who are in, and takes others while there is room.

    Browsers open and close connections as they like, so a viewer is whoever asks from one address.
    """

    def __init__(self, load: Load, clock: Callable[[], float]) -> None:
        self._load = load
        self._clock = clock
        self._asked: dict[str, float] = {}
        """When each address asked last; whoever asked the longest ago is first."""

    def check(self, address: str) -> None:
        """Raises ServerFull for an address that is not in, while there is no room."""
        now = self._clock()
        while self._asked and (first := next(iter(self._asked.items())))[1] < now - STAY_S:
            del self._asked[first[0]]
            self._load.left()
        if self._asked.pop(address, None) is None:
            if (retry_after := self._load.full()) is not None:
                self._load.refused()
                raise ServerFull(FULL, retry_after)
            self._load.entered()
        self._asked[address] = now
