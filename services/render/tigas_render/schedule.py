"""Which request is rendered next: clients get equal time of the renderer. No clock, no threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Generic, TypeVar

from tigas_render.frame import Client

Work = TypeVar("Work")


class Turns:
    """Self-clocked fair queueing (Golestani, 1994): among those who wait, each uses as many seconds.

    Everybody's next turn starts where the last one ended, in virtual time, and the earliest end is next. Virtual time
    is the end of the turn that was taken last, and whoever waits again starts there at the earliest: time that somebody
    did not use is not saved up.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._starts: dict[str, float] = {}
        """When everybody's next turn starts; the turns of those who are left out start now."""

    def join(self, name: str, waiting: Collection[str]) -> list[str]:
        """Somebody is among those who wait from now on.

        Returns whom this forgets: all others who neither wait nor have used more than those who do.
        """
        past = [other for other, start in self._starts.items() if start <= self._now and other not in waiting]
        for other in past:
            del self._starts[other]
        self._starts[name] = max(self._starts.get(name, self._now), self._now)
        return past

    def choose(self, costs: Mapping[str, float]) -> str:
        """Who of those who wait is next, by what each one's turn would cost; of equals, who came first."""
        if len(costs) == 1:
            return next(iter(costs))
        return min(costs, key=lambda name: self._starts[name] + costs[name])

    def begin(self, name: str, seconds: float) -> None:
        """Somebody takes a turn that is expected to take so long."""
        self.settle(name, seconds)
        self._now = max(self._now, self._starts[name])

    def settle(self, name: str, seconds: float) -> None:
        """Somebody has used so much more than was expected; less, if it is negative."""
        self._starts[name] = self._starts.get(name, self._now) + seconds


class FairSchedule(Generic[Work]):
    """Waiting work by address and session. Addresses get equal time, and so do the sessions of one address.

    A session's newest work goes first: it is what the viewer waits for. Each session keeps at most `depth` waiting
    items: the newest wins, so one more pushes its oldest out.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._waiting: dict[str, dict[str, list[tuple[Work, float]]]] = {}
        """Work and its cost by address and session, oldest first."""
        self._addresses = Turns()
        self._sessions: dict[str, Turns] = {}
        """By address."""
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def waiting(self, address: str) -> int:
        """How much work of one address waits."""
        return sum(map(len, self._waiting.get(address, {}).values()))

    def newest(self) -> Iterator[Work]:
        """What each session that waits is to get next."""
        return (waiting[-1][0] for sessions in self._waiting.values() for waiting in sessions.values())

    def others_wait(self, client: Client) -> bool:
        """Whether any work waits that is not this client's."""
        own = len(self._waiting.get(client.address, {}).get(client.session, []))
        return self._length > own

    def push(self, client: Client, work: Work, cost: float) -> Work | None:
        """Add a client's newest work, which is expected to take `cost` seconds; returns what it pushed out, if any."""
        if client.address not in self._waiting:
            self._waiting[client.address] = {}
            for forgotten in self._addresses.join(client.address, self._waiting):
                self._sessions.pop(forgotten, None)
        sessions = self._waiting[client.address]
        if client.session not in sessions:
            sessions[client.session] = []
            self._sessions.setdefault(client.address, Turns()).join(client.session, sessions)
        waiting = sessions[client.session]
        waiting.append((work, cost))
        if len(waiting) > self._depth:
            return waiting.pop(0)[0]
        self._length += 1
        return None

    def pop(self, besides: Collection[str] = (), at_most: float = math.inf) -> Work | None:
        """Take the newest work of the client whose turn it is; the client has its turn once the work begins.

        Nothing of the addresses `besides`, and nothing that costs more than `at_most` seconds; None if that is all.
        """
        chosen, costs = {}, {}
        for address, sessions in self._waiting.items():
            if address in besides:
                continue
            newest = {session: waiting[-1][1] for session, waiting in sessions.items() if waiting[-1][1] <= at_most}
            if newest:
                chosen[address] = self._sessions[address].choose(newest)
                costs[address] = newest[chosen[address]]
        if not costs:
            return None
        address = self._addresses.choose(costs)
        return self._take(Client(address, chosen[address]), -1)

    def begin(self, client: Client, cost: float) -> None:
        """A client's work begins, and is expected to take so many seconds."""
        self._addresses.begin(client.address, cost)
        self._sessions.setdefault(client.address, Turns()).begin(client.session, cost)

    def settle(self, client: Client, seconds: float) -> None:
        """A client's work took so much longer than expected; less, if it is negative."""
        self._addresses.settle(client.address, seconds)
        self._sessions.setdefault(client.address, Turns()).settle(client.session, seconds)

    def remove(self, client: Client, work: Work) -> bool:
        """Withdraw work that no longer matters; False if it does not wait any more."""
        waiting = self._waiting.get(client.address, {}).get(client.session, [])
        for position, (other, _) in enumerate(waiting):
            if other is work:
                self._take(client, position)
                return True
        return False

    def remove_if(self, client: Client, is_unwanted: Callable[[Work], bool]) -> list[Work]:
        """Take out, and return, whatever of a client's work is of no use any more."""
        unwanted = [
            work for work, _ in self._waiting.get(client.address, {}).get(client.session, ()) if is_unwanted(work)
        ]
        for work in unwanted:
            self.remove(client, work)
        return unwanted

    def _take(self, client: Client, position: int) -> Work:
        sessions = self._waiting[client.address]
        work, _ = sessions[client.session].pop(position)
        self._length -= 1
        if not sessions[client.session]:
            del sessions[client.session]
        if not sessions:
            del self._waiting[client.address]
        return work
