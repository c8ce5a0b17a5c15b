"""The queue of requests to render: adds work, chooses the next item, and answers dropped ones. Thread-safe."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Collection

from tigas_common.errors import DeadlineExceeded, Overloaded, Superseded, TigasError
from tigas_common.wire.render import Rung
from tigas_render.engine.cost_model import CostModel, LargeFrames
from tigas_render.engine.metrics import Utilisation
from tigas_render.engine.work import Work
from tigas_render.fair_queue import FairSchedule
from tigas_render.frame import Client, obsoletes

QUEUE_DEPTH = 4
"""Maximum number of waiting requests per session: enough for a burst, too few to build up delay."""
MAX_WAITING = 512
"""Maximum number of waiting requests of all clients together."""
WAITING_PER_ADDRESS = 128
"""Maximum number of waiting requests per address; further ones are refused."""
MIN_COST_S = 0.0001
"""Minimum charge for a turn in seconds, so that clients take turns even while the cost of their frames is unknown."""
INTERRUPTED_FOR = 4
"""A frame is interrupted for one of another address that is expected to be cheaper by this factor."""

STOPPING = "The server is stopping."


class WorkQueue:
    """A queue between the event loop, which adds and removes work, and the threads that make the frames."""

    def __init__(
        self,
        frames_in_flight: int,
        ladder: tuple[Rung, ...],
        clock: Callable[[], float],
        refuse: Callable[[Work, TigasError], None],
    ) -> None:
        """refuse: called with dropped work, on any thread."""
        self._clock = clock
        self._refuse = refuse
        self._most_at_work = max(2, frames_in_flight - 1)
        """Maximum number of an address's frames at work: encoding a large image takes a tenth of a second."""
        self._schedule: FairSchedule[Work] = FairSchedule(QUEUE_DEPTH)
        self._costs = CostModel()
        self._large_frames = LargeFrames(ladder, self._costs)
        self._utilisation = Utilisation(clock())
        self._waits_since: dict[Client, float] = {}
        """Since when each client has been waiting for any of its requests to begin."""
        self._at_work: Counter[str] = Counter()
        """Number of frames that have begun and are not done, by address."""
        self._alive: dict[Work, float] = {}
        """When each frame at work began, or last let another frame go first."""
        self._all_at_work: set[str] = set()
        """Addresses with the maximum number of frames at work."""
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._on_work: Callable[[], object] | None = None
        self._is_rendering = False
        self._is_called = False
        """Whether a thread has been woken and has not called `next` since."""
        self._closed = False

    def __len__(self) -> int:
        return len(self._schedule)

    @property
    def at_work(self) -> int:
        """Number of frames that have begun and are not done."""
        with self._lock:
            return len(self._alive)

    def longest_silence(self) -> float:
        """Seconds since the slowest frame at work last showed progress; 0 if there is no frame at work."""
        with self._lock:
            return self._clock() - min(self._alive.values()) if self._alive else 0.0

    def push(self, work: Work) -> None:
        """Add work. Raises Overloaded if too many requests are waiting."""
        client, request = work.client, work.request
        with self._lock:
            if self._closed or len(self._schedule) >= MAX_WAITING:
                raise Overloaded(STOPPING if self._closed else "Too many requests are waiting; send fewer.")
            if self._schedule.waiting_count(client.address) >= WAITING_PER_ADDRESS:
                raise Overloaded("Too many requests from this address are waiting; send fewer.")
            now = self._clock()
            self._utilisation.work(now)
            self._large_frames.heard_of(client, now)
            self._waits_since.setdefault(client, work.arrived)
            work.expected = max(MIN_COST_S, self._costs.at_least(request.scene, request.format, work.size.pixels))
            pushed_out = self._schedule.push(client, work, work.expected)
            if not self._is_rendering:
                self._call()
        if pushed_out is not None:
            self._refuse(pushed_out, Superseded("Newer requests of this client superseded this one."))

    def remove(self, work: Work) -> None:
        """Remove cancelled work if it is still waiting."""
        with self._lock:
            self._schedule.remove(work.client, work)

    def on_work(self, tell: Callable[[], object]) -> None:
        """Call `tell` for new work instead of waking a thread in `next`. It must cause calls of `take` until that
        returns None. It is called on the thread that pushes, with the lock held.
        """
        self._on_work = tell

    def take(self) -> Work | None:
        """Begin the next work, which the caller must pass to `done`. After None, the renderer counts as idle."""
        with self._lock:
            work = self._pop()
            if work is None:
                self._utilisation.rest(self._clock())
            return work

    def next(self) -> Work | None:
        """Wait for a turn and begin the next work; None once closed. The caller must call `rendered` and `done`."""
        with self._lock:
            while not self._closed:
                self._is_called = False
                if not self._is_rendering:
                    work = self._pop()
                    if work is not None:
                        self._is_rendering = True
                        self._utilisation.work(self._clock())
                        return work
                    self._utilisation.rest(self._clock())
                self._changed.wait()
            return None

    def rendered(self) -> None:
        """Pass the turn to another thread, if there is work."""
        with self._lock:
            self._is_rendering = False
            if self._schedule:
                self._call()
            else:
                self._utilisation.rest(self._clock())

    def next_ahead_of(self, work: Work) -> Work | None:
        """Like `next`, but does not wait, and takes only work that justifies interrupting this work."""
        with self._lock:
            self._alive[work] = self._clock()
            return self._pop({work.client.address}, work.expected / INTERRUPTED_FOR)

    def done(self, work: Work, seconds: float | None = None, *, is_whole: bool = False) -> None:
        """Record the end of work, and its cost in seconds; None means the expected cost.

        is_whole: the work produced a frame, so its cost predicts similar ones. No thread is woken, because the caller
        goes on to call `next`.
        """
        address, request = work.client.address, work.request
        with self._lock:
            del self._alive[work]
            self._at_work[address] -= 1
            if not self._at_work[address]:
                del self._at_work[address]
            self._all_at_work.discard(address)
            if seconds is not None:
                self._schedule.charge(work.client, max(seconds, MIN_COST_S) - work.expected)
                if is_whole:
                    self._costs.measured(request.scene, request.format, work.size.pixels, seconds)

    def state(self) -> tuple[float, float]:
        """The longest time, in seconds, that any client has been waiting for its next frame to begin; and the share of
        the time since the last call, 0 to 1, in which there was work.
        """
        with self._lock:
            now = self._clock()
            since = self._waits_since
            waiting = self._schedule.next_items()
            self._waits_since = {work.client: since.get(work.client, work.arrived) for work in waiting}
            oldest = min(self._waits_since.values(), default=now)
            return max(0.0, now - oldest), self._utilisation.share(now)

    def close(self) -> None:
        """Refuse all waiting and future work."""
        with self._lock:
            self._closed = True
            while (work := self._schedule.pop()) is not None:
                self._refuse(work, Overloaded(STOPPING))
            self._changed.notify_all()

    def _call(self) -> None:
        """Announce work. A burst wakes only one thread, because waking costs more than adding work."""
        if self._on_work is not None:
            self._on_work()
        elif not self._is_called:
            self._is_called = True
            self._changed.notify()

    def _pop(self, besides: Collection[str] = (), at_most: float = math.inf) -> Work | None:
        """Begin the next work that is allowed to, and charge it to its client; None if there is no such work.

        Skips the addresses in `besides`, addresses with the maximum number of frames at work, and work with an expected
        cost above `at_most`.
        """
        left_out = self._all_at_work.union(besides) if besides else self._all_at_work
        while (work := self._schedule.pop(left_out, at_most)) is not None:
            if work.is_over:
                continue
            try:
                self._check(work)
            except (DeadlineExceeded, Overloaded) as error:
                self._refuse(work, error)
                continue
            self._begin(work)
            return work
        return None

    def _begin(self, work: Work) -> None:
        client = work.client
        self._waits_since.pop(client, None)
        self._schedule.start_turn(client, work.expected)
        self._alive[work] = self._clock()
        self._at_work[client.address] += 1
        if self._at_work[client.address] >= self._most_at_work:
            self._all_at_work.add(client.address)
        for older in self._schedule.remove_if(client, lambda other: obsoletes(work.request, other.request)):
            self._refuse(older, Superseded("A newer view of this client is rendered instead."))

    def _check(self, work: Work) -> None:
        """Raise DeadlineExceeded or Overloaded if a frame must not be rendered now."""
        request, now = work.request, self._clock()
        if request.deadline_ms is not None:
            try:
                work.check_deadline(now + self._costs.at_least(request.scene, request.format, work.size.pixels))
            except DeadlineExceeded:
                self._costs.doubt(request.scene, request.format)
                raise
        client = work.client
        others_wait = self._schedule.has_other_viewers(client)
        self._large_frames.check(client, request, work.size, now, others_wait=others_wait)
        self._large_frames.heard_of(client, now)
