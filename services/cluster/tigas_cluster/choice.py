"""Which host a viewer is sent to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from tigas_cluster.fleet import HostState
from tigas_common.placement import Candidate, Placement, ranked

SETTLED_S = 2.0
"""Seconds until a viewer sent to a host appears in the host's own count."""
MOST_SENT = 1000
"""Maximum number of assignments remembered until then."""


class Choice:
    """Sends viewers of a scene to as few hosts as its demand needs, and among those to the one with the fewest."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._placement = Placement(clock)
        self._sent: deque[tuple[float, str]] = deque(maxlen=MOST_SENT)
        """Times of assignments that hosts may not have counted yet, by host."""

    def host(
        self, scene: str, hosts: Sequence[HostState], *, at: str | None = None, avoid: str | None = None
    ) -> HostState | None:
        """The host for a viewer of this scene; None if no host is up.

        at: its present host, which it keeps unless that host is down or draining. avoid: the host that refused it,
        chosen only if there is no other. If all hosts are full, one of them is returned.
        """
        if not hosts:
            return None
        staying = [host for host in hosts if not host.draining] or list(hosts)
        for host in staying:
            if host.name == at:
                return host
        places = self._placement.places(scene, [Candidate(host.name, host.pressed) for host in staying])
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
        """Viewers sent there that may not have been counted yet."""
        since = self._clock() - SETTLED_S
        while self._sent and self._sent[0][0] < since:
            self._sent.popleft()
        return sum(sent == name for _, sent in self._sent)
