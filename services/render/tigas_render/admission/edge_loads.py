"""The combined load of all edges, from their reports. A single process is the only edge, number 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from prometheus_client.core import CounterMetricFamily as Counter
from prometheus_client.core import GaugeMetricFamily as Gauge
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

from tigas_render.admission.load import LoadState

STALE_S = 5.0
"""Seconds without a report after which an edge is dropped."""


class EdgeLoads(Collector):
    """The newest load state of each edge, with Prometheus metrics."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._reports: dict[int, tuple[float, LoadState]] = {}

    def update(self, edge: int, state: LoadState) -> None:
        self._reports[edge] = (self._clock(), state)

    @property
    def states(self) -> dict[int, LoadState]:
        """The newest report of each running edge, by edge number."""
        since = self._clock() - STALE_S
        return {edge: state for edge, (at, state) in sorted(self._reports.items()) if at >= since}

    def retry_after_s(self) -> float | None:
        """Seconds after which a new viewer may try again; None if most edges would admit it, since clients cannot
        choose an edge.
        """
        states = self.states.values()
        waits = [state.full for state in states if state.full is not None]
        return max(waits) if waits and 2 * len(waits) >= len(states) else None

    @property
    def viewers(self) -> int:
        """Number of viewers on all edges."""
        return sum(state.viewers for state in self.states.values())

    @property
    def utilisation(self) -> float:
        """Utilisation of all edges together or of the renderer, whichever is higher, 0 to 1."""
        states = self.states.values()
        shares = ([state.utilisation for state in states], [state.engine_utilisation for state in states])
        return min(1.0, max(sum(each) / max(1, len(each)) for each in shares))

    @property
    def queue_age_s(self) -> float:
        """The longest wait in any queue during the last second."""
        return max((age for state in self.states.values() for age in state.ages.values()), default=0.0)

    def collect(self) -> Iterator[Metric]:
        age = "Longest wait in the last second"
        ages = Gauge("tigas_render_queue_age_seconds", age, labels=["queue", "edge"])
        shares = Gauge("tigas_render_utilisation_ratio", "Share of time at work, 0 to 1", labels=["of", "edge"])
        viewers = Gauge("tigas_render_viewers", "Admitted viewers", labels=["edge"])
        full = Gauge("tigas_render_full", "Whether new viewers are refused", labels=["edge"])
        rate = "Rate of each viewer, while limited"
        allowed = Gauge("tigas_render_allowed_requests_per_second", rate, labels=["edge"])
        refused = Counter("tigas_render_refused_viewers", "Refused viewers", labels=["edge"])
        stale = Counter("tigas_render_stale_datagrams", "Datagrams dropped for their age", labels=["edge"])
        batch = "Datagram batches refused by the kernel"
        batches = Counter("tigas_render_refused_batches", batch, labels=["edge"])
        for number, state in self.states.items():
            edge = [str(number)]
            for queue, queue_age in state.ages.items():
                ages.add_metric([queue, *edge], queue_age)
            shares.add_metric(["loop", *edge], state.utilisation)
            shares.add_metric(["engine", *edge], state.engine_utilisation)
            viewers.add_metric(edge, state.viewers)
            full.add_metric(edge, state.full is not None)
            if state.requests_per_s is not None:
                allowed.add_metric(edge, state.requests_per_s)
            refused.add_metric(edge, state.refused)
            stale.add_metric(edge, state.stale)
            batches.add_metric(edge, state.refused_batches)
        yield from (ages, shares, viewers, full, allowed, refused, stale, batches)
