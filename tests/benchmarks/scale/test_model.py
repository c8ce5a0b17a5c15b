"""What many viewers need."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from benchmarks.scale.model import Host, Workload, need, reach_km, sites, workloads

LIGHT = Workload("light", frames_per_s=10, kilobytes=10, gpu_frames_per_s=1000, cores_per_1000=2)
HOST = Host(gpus=1, cores=16, gbit_per_s=10, utilisation=1)


def test_a_viewer_s_bytes() -> None:
    assert LIGHT.mbit_per_s == pytest.approx(0.8)
    assert LIGHT.gigabytes_per_hour == pytest.approx(0.36)


@pytest.mark.parametrize(
    ("change", "viewers"),
    [
        ({}, 100),
        ({"gpus": 4}, 400),
        ({"utilisation": 0.7}, 70),
        ({"gpus": 100}, 800),  # no more than the processors can do
        ({"gbit_per_s": 0.04}, 50),
    ],
)
def test_a_host_serves_what_its_scarcest_part_allows(change: dict[str, Any], viewers: int) -> None:
    assert replace(HOST, **change).viewers(LIGHT) == viewers


def test_viewers_need_a_host_more_than_they_fill() -> None:
    assert need(1, LIGHT, HOST).hosts == 2
    needed = need(201, LIGHT, replace(HOST, gpus=2))
    assert (needed.hosts, needed.gpus) == (3, 6)
    assert needed.cores == pytest.approx(4.02)
    assert needed.gbit_per_s == pytest.approx(0.1608)


def test_a_host_that_serves_nobody_is_no_plan() -> None:
    with pytest.raises(ValueError, match="serves nobody"):
        need(1, LIGHT, replace(HOST, cores=0))


def test_a_site_reaches_as_far_as_the_round_trip_lasts() -> None:
    assert reach_km(round_trip_ms=50, access_ms=10) == 2000
    assert reach_km(round_trip_ms=10, access_ms=40) == 0


def test_a_region_needs_sites_by_its_area() -> None:
    assert sites(2000, reach=2000) == 1
    assert sites(2000, reach=1000) == 5
    assert sites(4000, reach=1000) == pytest.approx(4 * sites(2000, reach=1000), abs=1)


def test_the_page_takes_the_rate_that_was_measured() -> None:
    assert workloads()[-1].mbit_per_s == pytest.approx(10.2)
