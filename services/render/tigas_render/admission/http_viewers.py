"""Viewers by `POST /render`. They have no session that could be refused, so they name themselves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

from tigas_common.errors import ServerFull
from tigas_render.admission.load import FULL, Load

STAY_S = 30.0
"""Seconds for which a viewer stays admitted after its last request."""
MOST_NAMED: Final = 64
"""The most viewers of one address that are distinguished, as many as its sessions; further ones count as one."""


class HttpViewers:
    """The admitted viewers, and the admission of others while there is room.

    Browsers open and close connections as they like, so a viewer is a name that it chooses at its address, or the
    address itself without a name.
    """

    def __init__(self, load: Load, clock: Callable[[], float]) -> None:
        self._load = load
        self._clock = clock
        self._asked: dict[tuple[str, str], float] = {}
        """The time of the last request, by address and name, the oldest first."""
        self._named: Counter[str] = Counter()
        """The number of viewers of each address."""

    def check(self, address: str, name: str = "") -> None:
        """Admit a viewer, or note its request. Raises ServerFull for a new one while there is no room."""
        self.forget_absent()
        viewer = (address, name)
        if viewer not in self._asked and self._named.get(address, 0) >= MOST_NAMED:
            viewer = (address, "")
        if self._asked.pop(viewer, None) is None:
            if (retry_after := self._load.full()) is not None:
                self._load.refused()
                raise ServerFull(FULL, retry_after)
            self._load.entered()
            self._named[address] += 1
        self._asked[viewer] = self._clock()

    def forget_absent(self) -> None:
        """Forget viewers without a request for STAY_S. Call it regularly, as there may be no other request."""
        since = self._clock() - STAY_S
        while self._asked and (first := next(iter(self._asked.items())))[1] < since:
            self._forget(first[0])

    def _forget(self, viewer: tuple[str, str]) -> None:
        del self._asked[viewer]
        self._load.left()
        self._named[viewer[0]] -= 1
        if not self._named[viewer[0]]:
            del self._named[viewer[0]]
