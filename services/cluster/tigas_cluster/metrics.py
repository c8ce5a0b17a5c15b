"""The director's figures for Prometheus: how each host is, and where viewers were sent."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from tigas_cluster.fleet import Fleet


class DirectorMetrics(Collector):
    """Of one director, in a registry of its own."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self.registry = CollectorRegistry()
        self.placements = Counter(
            "tigas_placements", "Viewers that were sent to a host", ["host"], registry=self.registry
        )
        self.redirects = Counter(
            "tigas_redirects",
            "Viewers that were sent to another host: `lost` could not get in, `silent` heard nothing, others `moved`",
            ["why"],
            registry=self.registry,
        )
        self.registry.register(self)

    def collect(self) -> Iterator[Metric]:
        """How the hosts are now."""
        hosts = self._fleet.hosts()
        up = GaugeMetricFamily("tigas_hosts", "Hosts that are up")
        up.add_metric([], len(hosts))
        viewers = GaugeMetricFamily("tigas_viewers", "Viewers that were taken", labels=["host"])
        full = GaugeMetricFamily("tigas_full", "Whether new viewers are refused", labels=["host"])
        draining = GaugeMetricFamily("tigas_draining", "Whether it is to end", labels=["host"])
        shares = GaugeMetricFamily("tigas_utilisation", "Share of the time at work, 0 to 1", labels=["host"])
        ages = GaugeMetricFamily(
            "tigas_queue_age_seconds", "The longest that something waited in the last second", labels=["host"]
        )
        for host in hosts:
            viewers.add_metric([host.name], host.viewers)
            full.add_metric([host.name], host.full is not None)
            draining.add_metric([host.name], host.draining)
            shares.add_metric([host.name], host.load.utilisation)
            ages.add_metric([host.name], host.queue_age_s)
        yield from (up, viewers, full, draining, shares, ages)
