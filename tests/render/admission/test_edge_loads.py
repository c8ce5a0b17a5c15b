"""The combined load of edges."""

from __future__ import annotations

from dataclasses import replace

from prometheus_client import CollectorRegistry, generate_latest

from tigas_render.admission.edge_loads import STALE_S, EdgeLoads
from tigas_render.admission.load import LoadState

IDLE = LoadState(
    utilisation=0.1,
    engine_utilisation=0.2,
    ages={"datagrams": 0.001, "loop": 0.002, "engine": 0.003},
    viewers=3,
    full=None,
    requests_per_s=None,
    refused=0,
    stale=0,
    refused_batches=4,
)
FULL = replace(IDLE, full=5.0, requests_per_s=20.0, refused=7)


def test_a_server_is_full_if_half_of_its_edges_are() -> None:
    loads = EdgeLoads(lambda: 100.0)
    assert loads.retry_after_s() is None
    loads.update(0, IDLE)
    assert loads.retry_after_s() is None
    loads.update(1, FULL)
    assert loads.retry_after_s() == 5.0
    loads.update(2, IDLE)
    assert loads.retry_after_s() is None
    loads.update(0, FULL)
    assert loads.retry_after_s() == 5.0


def test_an_edge_that_is_gone_counts_no_more() -> None:
    now = 100.0
    loads = EdgeLoads(lambda: now)
    loads.update(0, FULL)
    now += STALE_S + 1
    assert loads.retry_after_s() is None
    assert loads.states == {}


def test_prometheus_sees_each_edge() -> None:
    registry = CollectorRegistry()
    loads = EdgeLoads(lambda: 100.0)
    registry.register(loads)
    loads.update(0, IDLE)
    loads.update(1, FULL)
    text = generate_latest(registry).decode()
    for line in (
        'tigas_render_queue_age_seconds{edge="0",queue="datagrams"} 0.001',
        'tigas_render_queue_age_seconds{edge="1",queue="engine"} 0.003',
        'tigas_render_utilisation_ratio{edge="0",of="loop"} 0.1',
        'tigas_render_full{edge="0"} 0.0',
        'tigas_render_full{edge="1"} 1.0',
        'tigas_render_refused_viewers_total{edge="1"} 7.0',
        'tigas_render_allowed_requests_per_second{edge="1"} 20.0',
        'tigas_render_refused_batches_total{edge="0"} 4.0',
    ):
        assert line in text
