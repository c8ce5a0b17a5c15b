"""The director's figures for Prometheus: how each host is, and where viewers were sent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_cluster.fleet import Fleet


class DirectorMetrics(Collector):
    """Of one director."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self.placements: Counter[str] = Counter()
        """Viewers that were sent to a host, by its name."""
        self.redirects: Counter[str] = Counter(lost=0, silent=0, moved=0)
        """Viewers that came from another host, by reason."""

    def collect(self) -> Iterator[Metric]:
        """How the hosts are now, and how many viewers were sent where."""
        hosts = self._fleet.hosts()
        viewers = GaugeMetricFamily("tigas_director_viewers", "Viewers that a host has taken", labels=["host"])
        full = GaugeMetricFamily("tigas_director_host_full", "Whether it refuses new viewers", labels=["host"])
        draining = GaugeMetricFamily("tigas_director_host_draining", "Whether it is to end", labels=["host"])
        shares = GaugeMetricFamily(
            "tigas_director_host_utilisation_ratio", "Share of the time at work, 0 to 1", labels=["host"]
        )
        ages = GaugeMetricFamily(
            "tigas_director_host_queue_age_seconds", "Longest wait of the last second", labels=["host"]
        )
        for host in hosts:
            viewers.add_metric([host.name], host.viewers)
            full.add_metric([host.name], host.full is not None)
            draining.add_metric([host.name], host.draining)
            shares.add_metric([host.name], host.load.utilisation)
            ages.add_metric([host.name], host.queue_age_s)
        placements = CounterMetricFamily(
            "tigas_director_placements", "Viewers that were sent to a host", labels=["host"]
        )
        for name, number in self.placements.items():
            placements.add_metric([name], number)
        redirects = CounterMetricFamily(
            "tigas_director_redirects",
            "Viewers sent to another host: refused ones are `lost`, unanswered ones `silent`, others `moved`",
            labels=["why"],
        )
        for why, number in self.redirects.items():
            redirects.add_metric([why], number)
        yield GaugeMetricFamily("tigas_director_hosts", "Hosts that are up", len(hosts))
        yield from (viewers, full, draining, shares, ages, placements, redirects)
