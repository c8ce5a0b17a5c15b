"""Limits for HTTP/1.1 servers, for clients' rates and concurrent work, and for slow senders."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from tigas_common.errors import TigasError

SLACK = 3.25
"""Standard deviations above the mean that one process may serve. Clients are distributed over processes at random: with
the mean alone, the fullest process would refuse clients long before the limit. With this slack, 64 clients of one
address are all admitted by 6 or 12 processes in more than 99 % of cases, and no distribution admits more than two and a
half times the limit.
"""

Client = TypeVar("Client", bound=Hashable)


def share_limit(total: int, processes: int) -> int:
    """One process's part of a limit that several processes enforce independently."""
    mean = total / processes
    return min(total, math.ceil(mean + SLACK * math.sqrt(mean)))


class ServiceHttpLimits(BaseModel):
    """The setting `http_limits` of every service, a sub-table of its table in `tigas.toml`.

    The defaults suit about twenty viewers behind one address.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    connections: int = Field(default=512, ge=1, le=100_000)
    """Concurrent connections; further ones are answered with 503."""
    connections_per_address: int = Field(default=128, ge=1, le=100_000)
    """Concurrent connections of one IPv4 address or one /64 of IPv6."""
    loop_share_per_address: float = Field(default=0.2, gt=0, le=1)
    """Share of the event loop's time that one address may use in the long run, not counting frames."""


class HttpLimits(ServiceHttpLimits):
    """All limits of a server. Those below are not configurable; they admit an upload at 50 kbit/s.

    Times are in seconds.
    """

    header_s: float = 10.0
    """Until a request's headers are complete, and for each TLS handshake and shutdown."""
    body_s: float = 30.0
    """Until the next part of a request's body."""
    body_bytes_per_s: float = 500.0
    """Sustained rate below which a body is abandoned even if its parts arrive in time."""
    idle_s: int = 5
    """Until the next request on a connection."""
    unread_s: float = 30.0
    """Until a client reads its responses (on Linux)."""

    @classmethod
    def from_settings(cls, settings: ServiceHttpLimits) -> Self:
        return cls(**settings.model_dump())

    def per_process(self, processes: int) -> Self:
        """The limits of each of several processes, which count independently."""
        counts = ("connections", "connections_per_address")
        return self.model_copy(update={name: share_limit(getattr(self, name), processes) for name in counts})


class RateLimit(Generic[Client]):
    """A token bucket for each client. Full buckets are forgotten.

    `rate` is the amount per second in the long run, and `burst_s` the number of seconds' worth that may be used at
    once.
    """

    def __init__(self) -> None:
        self._full_at: dict[Client, float] = {}
        """When each bucket will be full again, least recently used first."""

    def __len__(self) -> int:
        return len(self._full_at)

    def delay_s(self, client: Client, now: float, rate: float, burst_s: float, amount: float = 1.0) -> float:
        """Return the seconds until a client may use this amount."""
        return max(0.0, max(now, self._full_at.get(client, now)) + amount / rate - (now + burst_s))

    def consume(self, client: Client, now: float, rate: float, amount: float = 1.0) -> None:
        """Count an amount, whether allowed or not; a negative one is refunded."""
        full_at = max(now, self._full_at.pop(client, now)) + amount / rate
        self._full_at[client] = full_at
        while self._full_at and (first := next(iter(self._full_at.items())))[1] <= now:
            del self._full_at[first[0]]

    def try_acquire(self, client: Client, now: float, rate: float, burst_s: float) -> bool:
        """Return whether a client may act once more now, and count it if so."""
        if self.delay_s(client, now, rate, burst_s) > 0:
            return False
        self.consume(client, now, rate)
        return True


class ConcurrencyLimit:
    """Counts concurrent work, in total and for each client."""

    def __init__(self, most: int, most_per_client: int) -> None:
        self._most = most
        self._most_per_client = most_per_client
        self._running: Counter[str] = Counter()

    @contextmanager
    def acquire(self, client: str, refusal: TigasError) -> Iterator[None]:
        """Context manager that counts one item. Raises `refusal` above the limit."""
        if self._running.total() >= self._most or self._running[client] >= self._most_per_client:
            raise refusal
        self._running[client] += 1
        try:
            yield
        finally:
            self._running[client] -= 1
            if not self._running[client]:
                del self._running[client]


@dataclass(slots=True)
class IdleTimeout:
    """Expires after `seconds` without progress, or below a sustained rate of `bytes_per_s`.

    A higher rate earns no credit: after any amount of data, silence is limited to `seconds`.
    """

    seconds: float
    bytes_per_s: float
    now: float
    """Start, on any clock that counts seconds."""
    expires_at: float = field(init=False)
    """Expiry, on the same clock."""

    def __post_init__(self) -> None:
        self.expires_at = self.now + self.seconds

    def extend(self, size: int, now: float) -> None:
        self.expires_at = min(now + self.seconds, self.expires_at + size / self.bytes_per_s)
