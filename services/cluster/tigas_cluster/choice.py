"""Which host a viewer is sent to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from tigas_cluster.fleet import HostState
from tigas_common.placement import Place, Placement, ranked

SETTLED_S = 2.0
"""Seconds after which a viewer that was sent to a host is among those that the host says it has."""
MOST_SENT = 1000
"""Of those that are not yet, the most that are remembered."""


class Choice:
    """Sends viewers of a scene to as few hosts as its demand needs, and among those to the one with the fewest."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._placement = Placement(clock)
        self._sent: deque[tuple[float, str]] = deque(maxlen=MOST_SENT)
        """When viewers were sent to which host, of those that no host may have counted yet."""

    def host(
        self, scene: str, hosts: Sequence[HostState], *, at: str | None = None, avoid: str | None = None
    ) -> HostState | None:
        """Where a viewer of this scene belongs; None if no host is up.

        at: the host that serves it now, which it stays with unless that is gone or drains. avoid: the host that it
        could not get into, which is named only if there is no other. If all are full, it is one of them.
        """
        if not hosts:
            return None
        staying = [host for host in hosts if not host.draining] or list(hosts)
        for host in staying:
            if host.name == at:
                return host
        places = self._placement.places(scene, [Place(host.name, host.pressed) for host in staying])
        usable = [host for host in staying if host.name != avoid] or staying
        taking = [host for host in usable if host.full is None]
        if not taking:
            return min(usable, key=lambda host: host.full or 0.0)
        # Those after its places, if they cannot have it, are the same for every viewer.
        of_scene = [host for host in taking if host.name in places]
        order = ranked(scene, tuple(host.name for host in taking))
        chosen = min(
            of_scene or [host for host in taking if host.name == order[0]],
            key=lambda host: (host.viewers + self._expected(host.name), order.index(host.name)),
        )
        self._sent.append((self._clock(), chosen.name))
        return chosen

    def _expected(self, name: str) -> int:
        """Viewers that were sent there and may not have been counted yet."""
        since = self._clock() - SETTLED_S
        while self._sent and self._sent[0][0] < since:
            self._sent.popleft()
        return sum(sent == name for _, sent in self._sent)
