"""Decisions from the hosts' reports: where to send a viewer, how many hosts to run, and which ones to end. No I/O."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tigas_cluster.fleet import HostState
from tigas_cluster.settings import HostRange
from tigas_common.placement import Candidate, Placement, rank_names

COUNT_DELAY_S = 2.0
"""Seconds until a viewer sent to a host appears in the host's own count."""
MAX_ASSIGNMENTS = 1000
"""Maximum number of assignments remembered until then."""
SCALE_UP_DELAY_S = 2.0
"""Seconds of pressure on most hosts before another one is added, longer than a host may pause."""
SCALE_UP_SHARE, SCALE_DOWN_SHARE = 0.85, 0.6
"""A host is added if the hosts would exceed the first share of their capacity, and removed if the remaining ones would
stay below the second.
"""
MIN_DRAIN_S = 5.0
"""Seconds within which viewers that were sent to a host before it began to drain have arrived."""


class HostChooser:
    """Sends a scene's viewers to as few hosts as demand requires, and among them to the one with the fewest."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """clock: in seconds."""
        self._clock = clock
        self._placement = Placement(clock)
        self._assignments: deque[tuple[float, str]] = deque(maxlen=MAX_ASSIGNMENTS)
        """Time and host of assignments that hosts may not have counted yet."""

    def choose(
        self, scene: str, hosts: Sequence[HostState], *, at: str | None = None, avoid: str | None = None
    ) -> HostState | None:
        """The host for a viewer of this scene; None if no host is up.

        at: its present host, kept unless that is down or draining. avoid: the host that refused it, chosen only if
        there is no other. If all hosts are full, one of them is returned.
        """
        if not hosts:
            return None
        staying = [host for host in hosts if not host.draining] or list(hosts)
        for host in staying:
            if host.name == at:
                return host
        places = self._placement.places(scene, [Candidate(host.name, host.is_overloaded) for host in staying])
        usable = [host for host in staying if host.name != avoid] or staying
        taking = [host for host in usable if host.retry_after_s is None]
        if not taking:
            return min(usable, key=lambda host: host.retry_after_s or 0.0)
        # If none of the scene's places can take it, all viewers fall back to the same host.
        of_scene = [host for host in taking if host.name in places]
        order = rank_names(scene, tuple(host.name for host in taking))
        chosen = min(
            of_scene or [host for host in taking if host.name == order[0]],
            key=lambda host: (host.viewers + self._count_pending(host.name), order.index(host.name)),
        )
        self._assignments.append((self._clock(), chosen.name))
        return chosen

    def _count_pending(self, name: str) -> int:
        """Viewers sent there that may not have been counted yet."""
        since = self._clock() - COUNT_DELAY_S
        while self._assignments and self._assignments[0][0] < since:
            self._assignments.popleft()
        return sum(sent == name for _, sent in self._assignments)


@dataclass(frozen=True, slots=True)
class ScalingPlan:
    wanted: int
    """Number of hosts that should take viewers."""
    draining: frozenset[str]
    """Hosts that take no new viewers."""
    ending: frozenset[str]
    """Draining hosts to end now: they have no viewers left, or their time is up."""


class Scaler:
    """State of scaling: the wanted number of hosts, the capacity of one, and the draining ones.

    Scales up immediately, while more than half of the hosts are under pressure, or if there are more viewers than the
    hosts are known to hold. Scales down slowly: after a calm period the host with the fewest viewers drains, and it
    ends once they have left.
    """

    def __init__(self, allowed: HostRange, calm_s: float, grace_s: float, clock: Callable[[], float]) -> None:
        """calm_s: how long fewer hosts must have sufficed before one drains; grace_s: how long its viewers may stay;
        clock: in seconds.
        """
        self._allowed = allowed
        self._calm_s = calm_s
        self._grace_s = grace_s
        self._clock = clock
        self._wanted = allowed.lowest
        self._draining: dict[str, float] = {}
        """Start of draining, by host."""
        self._held = 0
        """Largest number of viewers that a host has had without being full."""
        self._full_at: int | None = None
        """Number of viewers of a host when it reported being full."""
        self._pressed_since: float | None = None
        self._calm_since: float | None = None

    def plan(self, hosts: Sequence[HostState], starting: int = 0) -> ScalingPlan:
        """Decide from the hosts' reports; `starting` more hosts have not reported yet."""
        now = self._clock()
        names = {host.name for host in hosts}
        self._draining = {name: since for name, since in self._draining.items() if name in names}
        serving = [host for host in hosts if host.name not in self._draining]
        self._update_capacity(serving)
        self._grow(hosts, serving, starting, now)
        self._shrink(hosts, serving, now)
        self._update_draining(serving, starting, now)
        ending = (host.name for host in hosts if host.name in self._draining and self._is_drained(host, now))
        return ScalingPlan(self._wanted, frozenset(self._draining), frozenset(ending))

    def _update_capacity(self, serving: Sequence[HostState]) -> None:
        self._held = max((self._held, *(host.viewers for host in serving if host.retry_after_s is None)))
        fullest = [host.viewers for host in serving if host.retry_after_s is not None and host.viewers > 0]
        if fullest:
            self._full_at = min(fullest)
        elif self._full_at is not None:
            self._full_at = max((self._full_at, *(host.viewers for host in serving)))

    def _grow(self, hosts: Sequence[HostState], serving: Sequence[HostState], starting: int, now: float) -> None:
        have, pressed = len(serving) + starting, sum(host.is_overloaded for host in serving)
        if 2 * pressed <= have:
            self._pressed_since = None
        elif self._pressed_since is None:
            self._pressed_since = now
        needed = have
        if self._pressed_since is not None and now >= self._pressed_since + SCALE_UP_DELAY_S:
            needed = have + math.ceil(pressed / 2)
        if self._full_at is not None:
            needed = max(needed, math.ceil(_count_viewers(hosts) / (SCALE_UP_SHARE * self._full_at)))
        self._wanted = self._allowed.clamp(max(self._wanted, needed))

    def _shrink(self, hosts: Sequence[HostState], serving: Sequence[HostState], now: float) -> None:
        holds = self._held if self._full_at is None else self._full_at
        enough = _count_viewers(hosts) <= SCALE_DOWN_SHARE * holds * (self._wanted - 1) and not any(
            host.is_overloaded for host in serving
        )
        if not enough or self._wanted == self._allowed.lowest:
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = now
        elif now >= self._calm_since + self._calm_s:
            self._wanted -= 1
            self._calm_since = now

    def _update_draining(self, serving: Sequence[HostState], starting: int, now: float) -> None:
        """Drain hosts, fewest viewers first, or restore draining ones, most recent first."""
        excess = len(serving) - self._wanted
        for host in sorted(serving, key=lambda host: (host.viewers, host.name))[: max(0, excess)]:
            self._draining[host.name] = now
        missing = self._wanted - len(serving) - starting
        for name in sorted(self._draining, key=self._draining.__getitem__, reverse=True)[: max(0, missing)]:
            del self._draining[name]

    def _is_drained(self, host: HostState, now: float) -> bool:
        drained_s = now - self._draining[host.name]
        return drained_s >= self._grace_s or (host.viewers == 0 and drained_s >= MIN_DRAIN_S)


def _count_viewers(hosts: Sequence[HostState]) -> int:
    return sum(host.viewers for host in hosts)
