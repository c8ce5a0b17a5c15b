"""The tables of docs/scale.md."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.scale.measured import FIGURES
from benchmarks.scale.model import Host, Workload, need, reach_km, server_and_page_ms, sites

RESPONSE_MS = 100
"""The goal for motion to photon, without reprojection."""
REPROJECTED_MS = 100
"""The round trip up to which a reprojected picture has next to no borders (docs/reprojection.md)."""
ACCESS_MS = {"fixed": 10, "mobile": 40}
"""Round trips of access networks: assumptions."""


@dataclass(frozen=True)
class Region:
    """A part of the world, as regions.toml has it."""

    name: str
    share: float
    radius_km: float


def read_regions(path: Path) -> list[Region]:
    """A file like regions.toml. A ValueError in one sentence if it is none."""
    try:
        regions = [Region(**region) for region in tomllib.loads(path.read_text(encoding="utf-8"))["region"]]
        together = sum(region.share for region in regions)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} has no list of regions with name, share and radius_km: {error}") from None
    if not math.isclose(together, 1):
        raise ValueError(f"The shares in {path} are {together:g} together, not 1.")
    return regions


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table, numbers to the right of all but the first column."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def measured_table() -> str:
    """What was measured."""
    return markdown(
        ["measured", "", "in", "commit"],
        [
            [one.what, f"{one.printed} {one.unit}".strip(), f"[{one.document}]({one.document})", one.commit]
            for one in FIGURES
        ],
    )


def viewer_table(workloads: Iterable[Workload], host: Host) -> str:
    """What one viewer takes, and how many a host serves."""
    one_gpu = Host(1, host.cores, host.gbit_per_s, 1)
    header = ["a viewer", "frames/s", "kB a frame", "Mbit/s", "GB an hour", "cores for 1,000 frames/s"]
    return markdown(
        [*header, "most on a GPU", "planned on a host"],
        [
            [
                workload.name,
                f"{workload.frames_per_s:g}",
                f"{workload.kilobytes:.0f}",
                f"{workload.mbit_per_s:.1f}",
                f"{workload.gigabytes_per_hour:.1f}",
                f"{workload.cores_per_1000:.1f}",
                f"{one_gpu.viewers(workload):,}",
                f"{host.viewers(workload):,}",
            ]
            for workload in workloads
        ],
    )


def need_table(workloads: Iterable[Workload], host: Host, viewers: Iterable[int]) -> str:
    """What many viewers take, in one place."""
    rows = []
    for count in viewers:
        for workload in workloads:
            needed = need(count, workload, host)
            bytes_an_hour = count * workload.gigabytes_per_hour / 1e3
            rows.append(
                [
                    f"{count:,}, {workload.name}",
                    f"{needed.hosts:,}",
                    f"{needed.gpus:,}",
                    f"{needed.cores:,.0f}",
                    f"{needed.gbit_per_s:,.0f}",
                    f"{bytes_an_hour:,.0f}",
                ]
            )
    return markdown(["viewers", "hosts", "GPUs", "cores at work", "Gbit/s", "TB an hour"], rows)


def reach_table() -> str:
    """How far viewers may be from their site."""
    without = RESPONSE_MS - server_and_page_ms()
    rows = [
        [what, f"{round_trip:.0f}", *(f"{reach_km(round_trip, access):,.0f}" for access in ACCESS_MS.values())]
        for what, round_trip in (
            (f"motion to photon of {RESPONSE_MS} ms, not reprojected", without),
            ("reprojected, next to no borders", REPROJECTED_MS),
        )
    ]
    return markdown(["goal", "round trip, ms", *(f"{name} access, km" for name in ACCESS_MS)], rows)


def region_table(viewers: int, workload: Workload, host: Host, regions: Iterable[Region]) -> str:
    """What viewers all over the world take, on mobile networks, at sites that reach them."""
    reaches = (
        reach_km(RESPONSE_MS - server_and_page_ms(), ACCESS_MS["mobile"]),
        reach_km(REPROJECTED_MS, ACCESS_MS["mobile"]),
    )
    rows = []
    totals = [0, 0, 0, 0]
    for region in regions:
        local = round(viewers * region.share)
        found = []
        for reach in reaches:
            places = sites(region.radius_km, reach)
            found += [places, places * need(math.ceil(local / places), workload, host).hosts]
        totals = [total + one for total, one in zip(totals, found, strict=True)]
        gbit = local * workload.mbit_per_s / 1e3
        rows.append([region.name, f"{local:,}", f"{gbit:,.0f}", *(f"{one:,}" for one in found)])
    everywhere = viewers * workload.mbit_per_s / 1e3
    rows.append(["all", f"{viewers:,}", f"{everywhere:,.0f}", *(f"{one:,}" for one in totals)])
    header = ["region", "viewers", "Gbit/s", "sites, not reprojected", "hosts", "sites, reprojected", "hosts"]
    return markdown(header, rows)
