"""One viewer: a movement at its own pace, and the outcome of every due frame."""

from __future__ import annotations

import asyncio
import math
import time
from dataclasses import dataclass
from typing import Any

from benchmarks.load.client import Client
from benchmarks.load.plan import Plan

IN_FLIGHT = 8
"""Maximum frames in flight of a viewer; a frame that is due beyond it is not requested."""
COMES_AGAIN_S = 1.0
"""Seconds until a refused or disconnected viewer returns, unless the service sets another time."""
SERVED = "served"
FATES = {200: SERVED, 409: "superseded", 429: "refused", 503: "overloaded", 504: "late"}
"""By an answer's status; with any other, it has `failed`."""
LATE = ("superseded", "late")
AFTER_REFUSAL_S = 0.15
"""A viewer refused for another reason pauses for this many seconds, like the page."""
GOLDEN = 0.618034
"""Multiples of it, modulo 1, are spread evenly, however many there are."""


@dataclass(frozen=True, slots=True)
class Due:
    """Outcome of a due frame. Times are seconds of the monotonic clock."""

    at: float
    fate: str
    """`served`; `overtaken` by a newer frame, and cancelled by the viewer; `superseded`, `late`, `overloaded`,
    `refused` or `failed`, as reported by the service; `reset`, or `lost` with the connection; or not requested: too
    many are `waiting`, the viewer was `paced` by the service's rate or just refused, or it was `outside`, without a
    session.
    """
    took: float = math.nan
    """From sending the request to the last byte, if there was an answer."""
    there: float = math.nan
    """When that was."""
    size: int = 0
    """Bytes of the answer."""
    lag: float = 0.0
    """How much of it is this process's own doing: sent late, or read late from the socket."""


@dataclass(frozen=True, slots=True)
class _Asked:
    seq: int
    due: float
    sent: float


class Viewer:
    """A viewer of the scene from its arrival until it leaves."""

    def __init__(self, plan: Plan, number: int) -> None:
        """number: of all viewers, from 0; gives an address, a movement and a place in it."""
        self.ended: list[Due] = []
        """Outcomes since the list was last cleared."""
        self.is_inside = False
        """Whether it may ask for frames."""
        self._plan = plan
        self._posts = plan.transport == "post" or (plan.transport == "mixed" and number % 2 == 1)
        self._source = _address(number) if plan.host.startswith("127.") else None
        self._route = number % len(plan.routes)
        self._frame = int(number * GOLDEN % 1 * len(plan.routes[self._route]))
        self._interval = 1 / plan.frames_per_s
        self._phase = number * GOLDEN % 1 * self._interval
        self._asked: dict[int, _Asked] = {}
        """By stream, the oldest first."""
        self._seq = 0
        self._spacing = 0.0
        """Of requests, that the service asks for, in seconds."""
        self._not_before = 0.0
        self._client: Client | None = None
        self._next: asyncio.TimerHandle | None = None
        self._again: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    def come(self) -> None:
        """Connect, and begin to move."""
        now = time.monotonic()
        self._due = now + self._phase
        self._next = self._loop.call_later(self._phase, self._frame_due)
        self._connect()

    def leave(self) -> None:
        """Close the connection."""
        for timer in (self._next, self._again):
            if timer is not None:
                timer.cancel()
        if self._client is not None:
            self._client.close()
        self.is_inside = False
        self._asked.clear()

    @property
    def dropped(self) -> int:
        """Datagrams received over this connection and dropped by the socket."""
        return 0 if self._client is None else self._client.dropped

    def waiting(self) -> list[float]:
        """Due times of the frames in flight."""
        return [asked.due for asked in self._asked.values()]

    def _connect(self) -> None:
        try:
            self._client = Client((self._plan.host, self._plan.port), self._source, self._posts, self)
        except OSError:
            self.closed(None)

    # -- asking ------------------------------------------------------------------------------------------------------

    def _frame_due(self) -> None:
        due, now = self._due, time.monotonic()
        self._due += self._interval
        self._next = self._loop.call_later(max(0.0, self._due - now), self._frame_due)
        self._frame += 1
        if not self.is_inside or self._client is None:
            self.ended.append(Due(due, "outside"))
        elif now < self._not_before:
            self.ended.append(Due(due, "paced"))
        elif len(self._asked) >= IN_FLIGHT:
            self.ended.append(Due(due, "waiting"))
        else:
            self._seq += 1
            self._not_before = max(self._not_before, now - self._interval) + self._spacing
            request = self._plan.request(self._route, self._frame, self._seq)
            stream_id = self._client.ask(request)
            if self.is_inside:  # sending has not failed
                self._asked[stream_id] = _Asked(self._seq, due, now)

    # -- hearing of the connection -----------------------------------------------------------------------------------

    def opened(self) -> None:
        """Frames may be requested."""
        self.is_inside = True

    def answered(self, stream_id: int, status: int, header: dict[str, Any], size: int, arrived: float) -> None:
        """An answer is there, whole."""
        asked = self._asked.pop(stream_id, None)
        if asked is None:  # overtaken
            return
        now = time.monotonic()
        rate = header.get("requests_per_s")
        self._spacing = 1 / rate if rate else 0.0
        fate = FATES.get(status, "failed")
        self.ended.append(Due(asked.due, fate, now - asked.sent, now, size, asked.sent - asked.due + now - arrived))
        if fate == SERVED:
            self._overtake(asked.seq)
        elif fate not in LATE:
            self._not_before = now + AFTER_REFUSAL_S

    def _overtake(self, seq: int) -> None:
        """Cancel the frames before the received one."""
        assert self._client is not None
        for stream_id, asked in list(self._asked.items()):
            if asked.seq < seq and self._asked.pop(stream_id, None) is not None:
                self.ended.append(Due(asked.due, "overtaken"))
                self._client.cancel(stream_id)

    def failed(self, stream_id: int) -> None:
        """The service has reset a stream."""
        asked = self._asked.pop(stream_id, None)
        if asked is not None:
            self.ended.append(Due(asked.due, "reset"))

    def closed(self, retry_after_s: float | None) -> None:
        """The connection is over, or was never made."""
        self.is_inside = False
        self.ended += [Due(asked.due, "lost") for asked in self._asked.values()]
        self._asked.clear()
        self._spacing = 0.0
        known = retry_after_s is not None and math.isfinite(retry_after_s)
        self._again = self._loop.call_later(retry_after_s if known and retry_after_s else COMES_AGAIN_S, self._connect)


def _address(number: int) -> str:
    """Of a viewer on this machine: the service is fair between addresses, and so each has its own."""
    return f"127.1.{number // 250}.{number % 250 + 1}"
