"""What many viewers need, from what one GPU was measured to do: arithmetic, linear in the number of GPUs and hosts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from benchmarks.scale import measured

FIBRE_KM_PER_MS = 200
"""Light in glass."""
DETOUR = 2
"""Cables are longer than the great circle, and routers take time: an assumption."""
COVERING_DENSITY = 2 * math.pi / math.sqrt(27)
"""Discs that cover the plane overlap at least so much (Kershner, 1939)."""


@dataclass(frozen=True)
class Workload:
    """What a viewer asks for, and what a GPU and its host make of it."""

    name: str
    frames_per_s: float
    """Of one viewer."""
    kilobytes: float
    """Of one frame, 10³ bytes."""
    gpu_frames_per_s: float
    """That one GPU serves with all frames in time."""
    cores_per_1000: float
    """Processors that 1,000 frames/s take."""

    @property
    def mbit_per_s(self) -> float:
        """To one viewer."""
        return self.frames_per_s * self.kilobytes * 8e-3

    @property
    def gigabytes_per_hour(self) -> float:
        """To one viewer."""
        return self.mbit_per_s / 8e3 * 3600


def workloads() -> list[Workload]:
    """Two as `make bench-load` offers them, and the page as it was measured over links."""
    fps = measured.OFFERED_PER_S.value
    small, large = measured.SMALL_VIEWERS.value * fps, measured.LARGE_VIEWERS.value * fps
    small_cores, large_cores = measured.SMALL_CORES.value / small * 1000, measured.LARGE_CORES.value / large * 1000
    views = measured.PAGE_VIEWS_PER_S.value
    page_kb = measured.PAGE_MBIT_PER_S.value / views / 8e-3
    return [
        Workload("640×360 at 30 frames/s", fps, measured.SMALL_KB.value, small, small_cores),
        Workload("1280×720 q90 at 30 frames/s", fps, measured.LARGE_KB.value, large, large_cores),
        Workload("the page, adaptive", views, page_kb, large, large_cores),
    ]


@dataclass(frozen=True)
class Host:
    """A machine, and how much of it is planned with."""

    gpus: int
    cores: int
    gbit_per_s: float
    utilisation: float
    """The share of what was measured as the most."""

    def viewers(self, workload: Workload) -> int:
        """That it serves: as many as the scarcest of GPUs, processors and network allows."""
        frames_per_s = min(
            self.gpus * workload.gpu_frames_per_s,
            self.cores / workload.cores_per_1000 * 1000,
            self.gbit_per_s * 1e3 / (workload.kilobytes * 8e-3),
        )
        return math.floor(frames_per_s * self.utilisation / workload.frames_per_s)


@dataclass(frozen=True)
class Need:
    """What some viewers take, at one place."""

    hosts: int
    """One more than necessary, so that one may fail."""
    gpus: int
    cores: float
    """That serve frames; hosts have more."""
    gbit_per_s: float


def need(viewers: int, workload: Workload, host: Host) -> Need:
    """What so many viewers take who are there at the same time. A ValueError if a host serves not one of them."""
    if host.viewers(workload) < 1:
        raise ValueError(
            f"A host with {host.gpus} GPUs, {host.cores} cores and {host.gbit_per_s:g} Gbit/s serves nobody."
        )
    hosts = math.ceil(viewers / host.viewers(workload)) + 1
    cores = viewers * workload.frames_per_s / 1000 * workload.cores_per_1000
    return Need(hosts, hosts * host.gpus, cores, viewers * workload.mbit_per_s / 1e3)


def server_and_page_ms() -> float:
    """Motion to photon without the round trip: the median of the page."""
    return measured.PAGE_RESPONSE_MS.value - measured.PAGE_ROUND_TRIP_MS.value


def reach_km(round_trip_ms: float, access_ms: float) -> float:
    """How far a viewer may be from the site, if the access network takes so much of the round trip."""
    return max(0.0, round_trip_ms - access_ms) / 2 * FIBRE_KM_PER_MS / DETOUR


def sites(radius_km: float, reach: float) -> int:
    """How many sites cover a region of this radius, each as far as it reaches, in km."""
    return 1 if reach >= radius_km else math.ceil(COVERING_DENSITY * (radius_km / reach) ** 2)
