"""Who views by `POST /render`: there is no session whose beginning could be refused, so viewers name themselves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

from tigas_common.errors import ServerFull
from tigas_render.transport.load import FULL, Load

STAY_S = 30.0
"""Who has asked within so many seconds is in."""
MOST_NAMED: Final = 64
"""Viewers of one address that are told apart, as many as it may have sessions; the others count as one."""


class HttpViewers:
    """Keeps those who are in, and takes others while there is room.

    Browsers open and close connections as they like, so a viewer is a name of its own choice at its address. Whoever
    gives none is the address itself.
    """

    def __init__(self, load: Load, clock: Callable[[], float]) -> None:
        self._load = load
        self._clock = clock
        self._asked: dict[tuple[str, str], float] = {}
        """When each viewer asked last, by address and name; whoever asked the longest ago is first."""
        self._named: Counter[str] = Counter()
        """How many of them each address has, with and without a name."""

    def check(self, address: str, name: str = "") -> None:
        """Raises ServerFull for a viewer that is not in, while there is no room."""
        now = self._clock()
        while self._asked and (first := next(iter(self._asked.items())))[1] < now - STAY_S:
            self._forget(first[0])
        viewer = (address, name)
        if viewer not in self._asked and self._named.get(address, 0) >= MOST_NAMED:
            viewer = (address, "")
        if self._asked.pop(viewer, None) is None:
            if (retry_after := self._load.full()) is not None:
                self._load.refused()
                raise ServerFull(FULL, retry_after)
            self._load.entered()
            self._named[address] += 1
        self._asked[viewer] = now

    def _forget(self, viewer: tuple[str, str]) -> None:
        del self._asked[viewer]
        self._load.left()
        self._named[viewer[0]] -= 1
        if not self._named[viewer[0]]:
            del self._named[viewer[0]]
