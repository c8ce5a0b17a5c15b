"""Fair scheduling, which gives clients equal time on the renderer. Uses no clock and no threads."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from typing import Generic, TypeVar

from tigas_render.frame import Client

Work = TypeVar("Work")


MIN_KEPT = 256
"""Number of clients up to which absent ones are kept, because the clients of a busy service return immediately."""


class FairQueue:
    """Self-clocked fair queueing (Golestani, 1994): equal seconds for each waiting client.

    In virtual time, each client's next turn starts where its last one ended, and the turn with the earliest end is
    next. Virtual time is the end of the last turn taken. A client that starts to wait again cannot start before it, so
    unused time is not saved up.
    """

    def __init__(self) -> None:
        self._time = 0.0
        self._starts: dict[str, float] = {}
        """Start of each client's next turn; clients without an entry start now."""
        self._cleanup_size = MIN_KEPT
        """Number of entries above which unnecessary ones are dropped."""
        self._costs: dict[str, float] = {}
        """Expected cost of each waiting client's next turn, in seconds."""
        self._ends: dict[str, float] = {}
        """End of each waiting client's next turn, stored because the choice is made for every frame, among hundreds."""

    def add(self, name: str, cost: float) -> list[str]:
        """Add a waiting client, with the expected cost of its turn in seconds.

        Returns the clients dropped by an occasional cleanup, which neither wait nor have used more time than the
        waiting clients.
        """
        self._starts[name] = max(self._starts.get(name, self._time), self._time)
        self.set_cost(name, cost)
        if len(self._starts) <= self._cleanup_size:
            return []
        past = [other for other, start in self._starts.items() if start <= self._time and other not in self._costs]
        for other in past:
            del self._starts[other]
        self._cleanup_size = max(MIN_KEPT, 2 * len(self._starts))
        return past

    def set_cost(self, name: str, cost: float) -> None:
        """Change the expected cost of a waiting client's next turn, in seconds."""
        self._costs[name] = cost
        self._ends[name] = self._starts[name] + cost

    def remove(self, name: str) -> None:
        del self._costs[name], self._ends[name]

    def peek(self, excluded: Collection[str] = (), max_cost: float = math.inf) -> str | None:
        """The next waiting client; among equals, the first.

        Skips clients in `excluded` and turns that cost more than `max_cost` seconds. None if no other client is left.
        """
        among: Collection[str] = self._ends
        if len(among) == 1 and not excluded and max_cost == math.inf:  # most addresses have one session
            return next(iter(among))
        if excluded or max_cost < math.inf:
            among = [name for name, cost in self._costs.items() if cost <= max_cost and name not in excluded]
        return min(among, key=self._ends.__getitem__, default=None)

    def start_turn(self, name: str, seconds: float) -> None:
        """Start a client's turn, with its expected length in seconds."""
        self.charge(name, seconds)
        self._time = max(self._time, self._starts[name])

    def charge(self, name: str, seconds: float) -> None:
        """Charge a client for the difference from the expected length in seconds, which may be negative."""
        self._starts[name] = start = self._starts.get(name, self._time) + seconds
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
        self._addresses = FairQueue()
        self._sessions: defaultdict[str, FairQueue] = defaultdict(FairQueue)
        """Turns of the sessions of each address."""
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def waiting_count(self, address: str) -> int:
        return sum(map(len, self._waiting.get(address, {}).values()))

    def next_items(self) -> Iterator[Work]:
        """The next work of each waiting session."""
        return (waiting[-1][0] for sessions in self._waiting.values() for waiting in sessions.values())

    def has_other_viewers(self, client: Client) -> bool:
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
            for forgotten in self._addresses.add(address, cost):
                self._sessions.pop(forgotten, None)
        sessions, queue = self._waiting[address], self._sessions[address]
        if session in sessions:
            queue.set_cost(session, cost)
        else:
            sessions[session] = []
            queue.add(session, cost)
        waiting = sessions[session]
        waiting.append((work, cost))
        self._length += 1
        self._update_cost(address)
        return self._take(client, 0) if len(waiting) > self._depth else None

    def pop(self, excluded: Collection[str] = (), max_cost: float = math.inf) -> Work | None:
        """Take the newest work of the next client. Its turn counts only once `start_turn` is called.

        Skips the addresses in `excluded`, and work that costs more than `max_cost` seconds. None if no other is left.
        """
        address = self._addresses.peek(excluded, max_cost)
        if address is None:
            return None
        session = self._sessions[address].peek()
        assert session is not None
        return self._take(Client(address, session), -1)

    def start_turn(self, client: Client, cost: float) -> None:
        """Start a client's turn, with its expected cost in seconds."""
        self._addresses.start_turn(client.address, cost)
        self._sessions[client.address].start_turn(client.session, cost)
        self._update_cost(client.address)

    def charge(self, client: Client, seconds: float) -> None:
        """Charge a client for the difference from the expected cost in seconds, which may be negative."""
        self._addresses.charge(client.address, seconds)
        self._sessions[client.address].charge(client.session, seconds)
        self._update_cost(client.address)

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
            self._sessions[address].set_cost(session, waiting[-1][1])
        else:
            del sessions[session]
            self._sessions[address].remove(session)
        if sessions:
            self._update_cost(address)
        else:
            del self._waiting[address]
            self._addresses.remove(address)
        return work

    def _update_cost(self, address: str) -> None:
        """Set the cost of an address's next turn to that of its next session's work."""
        sessions = self._waiting.get(address)
        if sessions is not None:
            session = self._sessions[address].peek()
            assert session is not None
            self._addresses.set_cost(address, sessions[session][-1][1])
