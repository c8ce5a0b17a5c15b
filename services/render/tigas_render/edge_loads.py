"""How busy all edges are: what each says of itself, together. In a single process that is the only edge, number 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_common.parsing import parse
from tigas_render.transport.load import LoadState

STALE_S = 5.0
"""An edge that has said nothing for so long is gone, in seconds."""


class EdgeLoads(Collector):
    """The newest state of each, also for Prometheus."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._heard: dict[int, tuple[float, LoadState]] = {}

    def heard(self, edge: int, state: LoadState) -> None:
        """An edge, by its number, says how busy it is."""
        self._heard[edge] = (self._clock(), state)

    def heard_json(self, edge: int, stats: bytes) -> None:
        """The same, from another process. Raises InvalidRequest for what no edge says."""
        self.heard(edge, parse(LoadState, stats))

    @property
    def states(self) -> dict[int, LoadState]:
        """By edge, of those that are there."""
        since = self._clock() - STALE_S
        return {edge: state for edge, (at, state) in sorted(self._heard.items()) if at >= since}

    def full(self) -> float | None:
        """Seconds after which a new viewer may try again; None if most edges take one, since nobody can choose."""
        states = self.states.values()
        waits = [state.full for state in states if state.full is not None]
        return max(waits) if waits and 2 * len(waits) >= len(states) else None

    @property
    def viewers(self) -> int:
        """Of all edges."""
        return sum(state.viewers for state in self.states.values())

    @property
    def utilisation(self) -> float:
        """Of the edges, taken together, or of the renderer, whichever is busier, 0 to 1."""
        states = self.states.values()
        shares = ([state.utilisation for state in states], [state.engine_utilisation for state in states])
        return min(1.0, max(sum(each) / max(1, len(each)) for each in shares))

    @property
    def queue_age_s(self) -> float:
        """The longest that anything waited anywhere in the last second."""
        return max((age for state in self.states.values() for age in state.ages.values()), default=0.0)

    def collect(self) -> Iterator[Metric]:
        """For Prometheus."""
        ages = GaugeMetricFamily(
            "tigas_render_queue_age_seconds",
            "The longest that something waited in the last second",
            labels=["queue", "edge"],
        )
        shares = GaugeMetricFamily(
            "tigas_render_utilisation_ratio", "Share of the time at work, 0 to 1", labels=["of", "edge"]
        )
        viewers = GaugeMetricFamily("tigas_render_viewers", "Viewers that were taken", labels=["edge"])
        full = GaugeMetricFamily("tigas_render_full", "Whether new viewers are refused", labels=["edge"])
        allowed = GaugeMetricFamily(
            "tigas_render_allowed_requests_per_second", "Of each viewer, while there is too much to do", labels=["edge"]
        )
        refused = CounterMetricFamily("tigas_render_refused_viewers", "Viewers that were refused", labels=["edge"])
        stale = CounterMetricFamily("tigas_render_stale_datagrams", "Datagrams dropped for their age", labels=["edge"])
        for number, state in self.states.items():
            edge = [str(number)]
            for queue, age in state.ages.items():
                ages.add_metric([queue, *edge], age)
            shares.add_metric(["loop", *edge], state.utilisation)
            shares.add_metric(["engine", *edge], state.engine_utilisation)
            viewers.add_metric(edge, state.viewers)
            full.add_metric(edge, state.full is not None)
            if state.requests_per_s is not None:
                allowed.add_metric(edge, state.requests_per_s)
            refused.add_metric(edge, state.refused)
            stale.add_metric(edge, state.stale)
        yield from (ages, shares, viewers, full, allowed, refused, stale)
