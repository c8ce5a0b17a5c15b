"""Measures a service: at given numbers of viewers, at its capacity and beyond, or against another one."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field

from scipy.stats import t as student

from benchmarks.load.crowd import Crowds
from benchmarks.load.server import Server
from benchmarks.load.step import Interval, ServerUse, Step

LEAST_PAIRS = 6
"""Minimum pairs of steps for an interval."""
BEYOND = (1.5, 2.0)
"""Loads offered after the search, relative to the capacity."""
LEAST_SERVED = 0.9995
"""Share of served frames that rounds to 100.0 %."""

PRECISION = 0.05
"""Within which the number is found, as a share of it."""

Told = Callable[[Step], None]
Waits = Callable[[str, float], None]
"""Waits until a time of the monotonic clock, while something is going on."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a step takes, in seconds."""

    seconds: float
    """That are measured."""
    warm_up_s: float


@dataclass(slots=True)
class Subject:
    """A service, and the viewers that look at its scene."""

    server: Server
    device: str
    """Its rendering device."""
    crowds: Crowds

    def step(self, viewers: int, timing: Timing, wait: Waits) -> Step:
        """Measure this number of viewers once. Raises RuntimeError if a process of viewers ends."""
        service, cpu_s = self.server.service, []

        def measured(until: float) -> None:
            wait(f"{viewers} viewers", until)
            if service is not None:
                cpu_s.append(service.cpu_s)

        observed = self.crowds.measure(viewers, timing.warm_up_s, timing.seconds, measured)
        use = None
        if service is not None:
            before, after = cpu_s
            use = ServerUse((after - before) / timing.seconds, service.megabytes, service.open_files)
        return Step.of(viewers, timing.seconds, observed, use)


@dataclass(slots=True)
class Capacity:
    """The largest number of viewers that a service serves as it should, and how it was found."""

    limit_ms: float
    """That the 95th percentile may have."""
    viewers: int = 0
    """The largest that held; 0 if none did."""
    found: bool = False
    """Whether more viewers were tried, and the service was the bottleneck."""
    steps: list[Step] = field(default_factory=list)
    beyond: list[Step] = field(default_factory=list)
    """At that number once more, and above it."""

    def holds(self, step: Step) -> bool:
        """Whether all were served, and in time."""
        return step.served >= LEAST_SERVED and not step.outside and step.p95_ms <= self.limit_ms


def search(first: int, most: int) -> Generator[int, bool, int]:
    """Yields numbers of viewers to try, and is sent whether each is served properly.

    Returns the largest served number, 0 if there was none. Tries none above `most`, and none twice.
    """
    good, bad, count = 0, most + 1, min(first, most)
    doubling = True
    while bad - good > max(1, round(PRECISION * good)):
        if (yield count):
            good = count
        else:
            bad, doubling = count, False
        count = min(2 * good, most) if doubling else (good + bad) // 2
    return good


def measure_capacity(
    subject: Subject, capacity: Capacity, first: int, most: int, steps: int, timing: Timing, told: Told, wait: Waits
) -> None:
    """Find the capacity in at most this many steps, and measure overload. Fills `capacity` while running."""
    looking = search(first, most)
    viewers = next(looking)
    for _ in range(steps):
        step = subject.step(viewers, timing, wait)
        told(step)
        capacity.steps.append(step)
        good = capacity.holds(step)
        if good:
            capacity.viewers = max(capacity.viewers, viewers)
        try:
            viewers = looking.send(good)
        except StopIteration:
            break
    failed = [step for step in capacity.steps if step.viewers > capacity.viewers]
    capacity.found = bool(failed) and min(failed, key=lambda step: step.viewers).bottleneck is None
    for factor in (1.0, *BEYOND) if capacity.viewers else ():
        step = subject.step(round(factor * capacity.viewers), timing, wait)
        told(step)
        capacity.beyond.append(step)


@dataclass(frozen=True, slots=True)
class Ratio:
    """How many times a figure of one service is that of another."""

    value: float
    """The geometric mean over pairs of steps."""
    interval: Interval | None
    """95 %, by Student's t over the pairs; None with too few."""

    @classmethod
    def of(cls, pairs: Sequence[tuple[float, float]]) -> Ratio | None:
        """Ratios of alternating measurements; None without data."""
        logarithms = [math.log(one / other) for one, other in pairs if one > 0 and other > 0]
        if not logarithms:
            return None
        mean = statistics.fmean(logarithms)
        if len(logarithms) < LEAST_PAIRS:
            return cls(math.exp(mean), None)
        half = student.ppf(0.975, len(logarithms) - 1) * statistics.stdev(logarithms) / math.sqrt(len(logarithms))
        return cls(math.exp(mean), (math.exp(mean - half), math.exp(mean + half)))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two services at the same number of viewers, measured in turns."""

    viewers: int
    pairs: tuple[tuple[Step, Step], ...]
    """The measured service and the baseline."""

    def ratio(self, figure: Callable[[Step], float]) -> Ratio | None:
        """Of a figure."""
        return Ratio.of([(figure(one), figure(other)) for one, other in self.pairs])


def compare(
    subject: Subject, baseline: Subject, viewers: int, pairs: int, timing: Timing, told: Told, wait: Waits
) -> Comparison:
    """Measure this many pairs of steps, alternating the order."""
    measured = []
    for number in range(pairs):
        steps: dict[int, Step] = {}
        for which in ((0, 1), (1, 0))[number % 2]:
            one = (subject, baseline)[which]
            steps[which] = one.step(viewers, timing, wait)
            told(steps[which])
            one.crowds.clear()
        measured.append((steps[0], steps[1]))
    return Comparison(viewers, tuple(measured))
