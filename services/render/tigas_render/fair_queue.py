"""Fair scheduling, which gives clients equal time on the renderer. Uses no clock and no threads."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from typing import Generic, TypeVar

from tigas_render.frame import Client

Work = TypeVar("Work")


LEAST_KEPT = 256
"""Number of clients up to which absent ones are kept, because the clients of a busy service return immediately."""


class Turns:
    """Self-clocked fair queueing (Golestani, 1994): equal seconds for each waiting client.

    In virtual time, each client's next turn starts where its last one ended, and the turn with the earliest end is
    next. Virtual time is the end of the last turn taken. A client that starts to wait again cannot start before it, so
    unused time is not saved up.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._starts: dict[str, float] = {}
        """Start of each client's next turn; clients without an entry start now."""
        self._most = LEAST_KEPT
        """Number of entries above which unnecessary ones are dropped."""
        self._costs: dict[str, float] = {}
        """Expected cost of each waiting client's next turn, in seconds."""
        self._ends: dict[str, float] = {}
        """End of each waiting client's next turn, stored because the choice is made for every frame, among hundreds."""

    def join(self, name: str, cost: float) -> list[str]:
        """Add a waiting client, with the expected cost of its turn in seconds.

        Returns the clients dropped by an occasional cleanup, which neither wait nor have used more time than the
        waiting clients.
        """
        self._starts[name] = max(self._starts.get(name, self._now), self._now)
        self.wait_for(name, cost)
        if len(self._starts) <= self._most:
            return []
        past = [other for other, start in self._starts.items() if start <= self._now and other not in self._costs]
        for other in past:
            del self._starts[other]
        self._most = max(LEAST_KEPT, 2 * len(self._starts))
        return past

    def wait_for(self, name: str, cost: float) -> None:
        """Change the expected cost of a waiting client's next turn, in seconds."""
        self._costs[name] = cost
        self._ends[name] = self._starts[name] + cost

    def leave(self, name: str) -> None:
        del self._costs[name], self._ends[name]

    def next(self, besides: Collection[str] = (), at_most: float = math.inf) -> str | None:
        """The next waiting client; among equals, the first.

        Skips clients in `besides` and turns that cost more than `at_most` seconds. None if no other client is left.
        """
        among: Collection[str] = self._ends
        if len(among) == 1 and not besides and at_most == math.inf:  # most addresses have one session
            return next(iter(among))
        if besides or at_most < math.inf:
            among = [name for name, cost in self._costs.items() if cost <= at_most and name not in besides]
        return min(among, key=self._ends.__getitem__, default=None)

    def begin(self, name: str, seconds: float) -> None:
        """Start a client's turn, with its expected length in seconds."""
        self.settle(name, seconds)
        self._now = max(self._now, self._starts[name])

    def settle(self, name: str, seconds: float) -> None:
        """Charge a client for the difference from the expected length in seconds, which may be negative."""
        self._starts[name] = start = self._starts.get(name, self._now) + seconds
        if name in self._costs:
            self._ends[name] = start + self._costs[name]


class FairSchedule(Generic[Work]):
    """Waiting work by address and session. Addresses get equal time, and so do the sessions of an address.

    A session's newest work is first, because its viewer is waiting for it. Each session keeps at most `depth` waiting
    items; an additional one displaces the oldest.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._waiting: dict[str, dict[str, list[tuple[Work, float]]]] = {}
        """Work and its cost by address and session, oldest first."""
        self._addresses = Turns()
        self._sessions: defaultdict[str, Turns] = defaultdict(Turns)
        """Turns of the sessions of each address."""
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def waiting(self, address: str) -> int:
        return sum(map(len, self._waiting.get(address, {}).values()))

    def newest(self) -> Iterator[Work]:
        """The next work of each waiting session."""
        return (waiting[-1][0] for sessions in self._waiting.values() for waiting in sessions.values())

    def others_wait(self, client: Client) -> bool:
        """Whether work of another viewer is waiting."""
        viewer = client.viewer
        sessions = self._waiting.get(client.address, {}).items()
        own = (len(works) for session, works in sessions if Client(client.address, session).viewer == viewer)
        return self._length > sum(own)

    def push(self, client: Client, work: Work, cost: float) -> Work | None:
        """Add a client's newest work, with its expected cost in seconds. Returns the displaced work, if any."""
        address, session = client.address, client.session
        if address not in self._waiting:
            self._waiting[address] = {}
            for forgotten in self._addresses.join(address, cost):
                self._sessions.pop(forgotten, None)
        sessions, turns = self._waiting[address], self._sessions[address]
        if session in sessions:
            turns.wait_for(session, cost)
        else:
            sessions[session] = []
            turns.join(session, cost)
        waiting = sessions[session]
        waiting.append((work, cost))
        self._length += 1
        self._choose(address)
        return self._take(client, 0) if len(waiting) > self._depth else None

    def pop(self, besides: Collection[str] = (), at_most: float = math.inf) -> Work | None:
        """Take the newest work of the next client. Its turn counts only once `begin` is called.

        Skips the addresses in `besides`, and work that costs more than `at_most` seconds. None if no other is left.
        """
        address = self._addresses.next(besides, at_most)
        if address is None:
            return None
        session = self._sessions[address].next()
        assert session is not None
        return self._take(Client(address, session), -1)

    def begin(self, client: Client, cost: float) -> None:
        """Start a client's turn, with its expected cost in seconds."""
        self._addresses.begin(client.address, cost)
        self._sessions[client.address].begin(client.session, cost)
        self._choose(client.address)

    def settle(self, client: Client, seconds: float) -> None:
        """Charge a client for the difference from the expected cost in seconds, which may be negative."""
        self._addresses.settle(client.address, seconds)
        self._sessions[client.address].settle(client.session, seconds)
        self._choose(client.address)

    def remove(self, client: Client, work: Work) -> bool:
        """Remove work; False if it is not waiting any more."""
        return bool(self.remove_if(client, lambda other: other is work))

    def remove_if(self, client: Client, is_unwanted: Callable[[Work], bool]) -> list[Work]:
        """Remove and return a client's unwanted work."""
        waiting = self._waiting.get(client.address, {}).get(client.session, [])
        positions = [position for position, (work, _) in enumerate(waiting) if is_unwanted(work)]
        return [self._take(client, position) for position in reversed(positions)]

    def _take(self, client: Client, position: int) -> Work:
        address, session = client.address, client.session
        sessions = self._waiting[address]
        waiting = sessions[session]
        work, _ = waiting.pop(position)
        self._length -= 1
        if waiting:
            self._sessions[address].wait_for(session, waiting[-1][1])
        else:
            del sessions[session]
            self._sessions[address].leave(session)
        if sessions:
            self._choose(address)
        else:
            del self._waiting[address]
            self._addresses.leave(address)
        return work

    def _choose(self, address: str) -> None:
        """Set the cost of an address's next turn to that of its next session's work."""
        sessions = self._waiting.get(address)
        if sessions is not None:
            session = self._sessions[address].next()
            assert session is not None
            self._addresses.wait_for(address, sessions[session][-1][1])
