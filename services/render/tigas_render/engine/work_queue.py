"""The queue of requests to render: adds work, chooses the next item, and answers dropped ones. Thread-safe."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Collection

from tigas_common.errors import DeadlineExceeded, Overloaded, Superseded, TigasError
from tigas_common.wire.render import Rung
from tigas_render.engine.cost_model import CostModel, LargeFrameLimit
from tigas_render.engine.metrics import Utilisation
from tigas_render.engine.work import Work
from tigas_render.fair_queue import FairSchedule
from tigas_render.frame import Client, supersedes

QUEUE_DEPTH = 4
"""Maximum number of waiting requests per session: enough for a burst, too few to build up delay."""
MAX_WAITING = 512
"""Maximum number of waiting requests of all clients together."""
WAITING_PER_ADDRESS = 128
"""Maximum number of waiting requests per address; further ones are refused."""
MIN_COST_S = 0.0001
"""Minimum charge for a turn in seconds, so that clients take turns even while the cost of their frames is unknown."""
INTERRUPTION_RATIO = 4
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
        self._max_in_progress = max(2, frames_in_flight - 1)
        """Maximum number of an address's frames at work: encoding a large image takes a tenth of a second."""
        self._schedule: FairSchedule[Work] = FairSchedule(QUEUE_DEPTH)
        self._costs = CostModel()
        self._large_frames = LargeFrameLimit(ladder, self._costs)
        self._utilisation = Utilisation(clock())
        self._waiting_since: dict[Client, float] = {}
        """Since when each client has been waiting for any of its requests to begin."""
        self._in_progress: Counter[str] = Counter()
        """Number of frames that have begun and are not done, by address."""
        self._progress_at: dict[Work, float] = {}
        """When each frame at work began, or last let another frame go first."""
        self._saturated: set[str] = set()
        """Addresses with the maximum number of frames at work."""
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._listener: Callable[[], object] | None = None
        self._is_rendering = False
        self._is_notified = False
        """Whether a thread has been woken and has not called `pop` since."""
        self._closed = False

    def __len__(self) -> int:
        return len(self._schedule)

    @property
    def in_progress(self) -> int:
        """Number of frames that have begun and are not done."""
        with self._lock:
            return len(self._progress_at)

    def longest_stall_s(self) -> float:
        """Seconds since the slowest frame at work last showed progress; 0 if there is no frame at work."""
        with self._lock:
            return self._clock() - min(self._progress_at.values()) if self._progress_at else 0.0

    def push(self, work: Work) -> None:
        """Add work. Raises Overloaded if too many requests are waiting."""
        client, request = work.client, work.request
        with self._lock:
            if self._closed or len(self._schedule) >= MAX_WAITING:
                raise Overloaded(STOPPING if self._closed else "Too many requests are waiting; send fewer.")
            if self._schedule.waiting_count(client.address) >= WAITING_PER_ADDRESS:
                raise Overloaded("Too many requests from this address are waiting; send fewer.")
            now = self._clock()
            self._utilisation.mark_busy(now)
            self._large_frames.record_activity(client, now)
            self._waiting_since.setdefault(client, work.arrived)
            work.expected = max(MIN_COST_S, self._costs.lower_bound(request.scene, request.format, work.size.pixels))
            pushed_out = self._schedule.push(client, work, work.expected)
            if not self._is_rendering:
                self._notify()
        if pushed_out is not None:
            self._refuse(pushed_out, Superseded("Newer requests of this client superseded this one."))

    def remove(self, work: Work) -> None:
        """Remove cancelled work if it is still waiting."""
        with self._lock:
            self._schedule.remove(work.client, work)

    def set_listener(self, listener: Callable[[], object]) -> None:
        """Call `listener` for new work instead of waking a thread in `pop`. It must cause calls of `pop_nowait` until
        one returns None. It is called on the thread that pushes, with the lock held.
        """
        self._listener = listener

    def pop_nowait(self) -> Work | None:
        """Begin the next work, which the caller must pass to `finish`. After None, the renderer counts as idle."""
        with self._lock:
            work = self._start_next()
            if work is None:
                self._utilisation.mark_idle(self._clock())
            return work

    def pop(self) -> Work | None:
        """Wait for a turn and begin the next work; None once closed. The caller must call `yield_turn` and `finish`."""
        with self._lock:
            while not self._closed:
                self._is_notified = False
                if not self._is_rendering:
                    work = self._start_next()
                    if work is not None:
                        self._is_rendering = True
                        self._utilisation.mark_busy(self._clock())
                        return work
                    self._utilisation.mark_idle(self._clock())
                self._changed.wait()
            return None

    def yield_turn(self) -> None:
        """Pass the turn to another thread, if there is work."""
        with self._lock:
            self._is_rendering = False
            if self._schedule:
                self._notify()
            else:
                self._utilisation.mark_idle(self._clock())

    def pop_urgent(self, work: Work) -> Work | None:
        """Like `pop`, but does not wait, and takes only work that justifies interrupting this work."""
        with self._lock:
            self._progress_at[work] = self._clock()
            return self._start_next({work.client.address}, work.expected / INTERRUPTION_RATIO)

    def finish(self, work: Work, seconds: float | None = None, *, is_whole: bool = False) -> None:
        """Record the end of work, and its cost in seconds; None means the expected cost.

        is_whole: the work produced a frame, so its cost predicts similar ones. No thread is woken, because the caller
        goes on to call `pop`.
        """
        address, request = work.client.address, work.request
        with self._lock:
            del self._progress_at[work]
            self._in_progress[address] -= 1
            if not self._in_progress[address]:
                del self._in_progress[address]
            self._saturated.discard(address)
            if seconds is not None:
                self._schedule.charge(work.client, max(seconds, MIN_COST_S) - work.expected)
                if is_whole:
                    self._costs.add_measurement(request.scene, request.format, work.size.pixels, seconds)

    def state(self) -> tuple[float, float]:
        """The longest time, in seconds, that any client has been waiting for its next frame to begin; and the share of
        the time since the last call, 0 to 1, in which there was work.
        """
        with self._lock:
            now = self._clock()
            since = self._waiting_since
            waiting = self._schedule.next_items()
            self._waiting_since = {work.client: since.get(work.client, work.arrived) for work in waiting}
            oldest = min(self._waiting_since.values(), default=now)
            return max(0.0, now - oldest), self._utilisation.read(now)

    def close(self) -> None:
        """Refuse all waiting and future work."""
        with self._lock:
            self._closed = True
            while (work := self._schedule.pop()) is not None:
                self._refuse(work, Overloaded(STOPPING))
            self._changed.notify_all()

    def _notify(self) -> None:
        """Announce work. A burst wakes only one thread, because waking costs more than adding work."""
        if self._listener is not None:
            self._listener()
        elif not self._is_notified:
            self._is_notified = True
            self._changed.notify()

    def _start_next(self, excluded: Collection[str] = (), max_cost: float = math.inf) -> Work | None:
        """Begin the next work that is allowed to, and charge it to its client; None if there is no such work.

        Skips the addresses in `excluded`, addresses with the maximum number of frames at work, and work with a
        higher expected cost than `max_cost`.
        """
        left_out = self._saturated.union(excluded) if excluded else self._saturated
        while (work := self._schedule.pop(left_out, max_cost)) is not None:
            if work.is_over:
                continue
            try:
                self._check(work)
            except (DeadlineExceeded, Overloaded) as error:
                self._refuse(work, error)
                continue
            self._start(work)
            return work
        return None

    def _start(self, work: Work) -> None:
        client = work.client
        self._waiting_since.pop(client, None)
        self._schedule.start_turn(client, work.expected)
        self._progress_at[work] = self._clock()
        self._in_progress[client.address] += 1
        if self._in_progress[client.address] >= self._max_in_progress:
            self._saturated.add(client.address)
        for older in self._schedule.remove_if(client, lambda other: supersedes(work.request, other.request)):
            self._refuse(older, Superseded("A newer view of this client is rendered instead."))

    def _check(self, work: Work) -> None:
        """Raise DeadlineExceeded or Overloaded if a frame must not be rendered now."""
        request, now = work.request, self._clock()
        if request.deadline_ms is not None:
            try:
                work.check_deadline(now + self._costs.lower_bound(request.scene, request.format, work.size.pixels))
            except DeadlineExceeded:
                self._costs.decay(request.scene, request.format)
                raise
        client = work.client
        others_wait = self._schedule.has_other_viewers(client)
        self._large_frames.check(client, request, work.size, now, others_wait=others_wait)
        self._large_frames.record_activity(client, now)
