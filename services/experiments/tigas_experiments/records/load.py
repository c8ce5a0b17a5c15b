"""The load of the machine during a run: under high load, latencies reflect the machine, not the network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from tigas_common.wire.model import WireModel

LIMIT = 0.9
"""Above this share of busy time, work waits for a processor, or for a thread."""
TOO_OFTEN = 0.1
"""In more than this share of a run's samples, it is worth saying."""
WatchedServices = Literal["threads", "processors", "elsewhere"]
"""Extent of watching the services: each of their threads; only the processors shared with the browser; nothing, since
some of them ran on another machine.
"""


class LoadSample(WireModel):
    """One moment, or the interval since the previous sample."""

    unix_ms: float
    cpu: float
    """Busy share, 0 to 1, of the processors available to the run or of the time granted by a control group, whichever
    is greater. Early runs: of all processors of the machine.
    """
    processors: float | None = None
    """How many the run might use; unknown of early runs."""
    throttled: bool = False
    """Whether a control group had to wait, as its time was used up."""
    threads: dict[str, float] | None = None
    """Busy share of each process's busiest thread, 0 to 1, by process name; None if not monitored."""
    load_average: float
    """Average number of running or runnable processes over the last minute."""


class Load(WireModel):
    """A whole run."""

    cpu_mean: float
    cpu_max: float
    saturated_share: float
    """Share of the samples in which processors were above LIMIT (95 % in early runs), or a control group waited."""
    load_average_max: float
    processors: float | None
    """How many the run might use; of early runs, how many the machine had."""
    pegged: dict[str, float] | None = None
    """Share of samples with a thread above LIMIT, by process name; None if not monitored."""
    services: WatchedServices | None = None
    """None for runs made on a page, and for early ones."""

    @property
    def saturated(self) -> bool:
        """Whether the figures have to be doubted."""
        return self.saturated_share > TOO_OFTEN

    @property
    def often_pegged(self) -> dict[str, float]:
        """The significant entries of `pegged`, highest first."""
        often = [each for each in (self.pegged or {}).items() if each[1] > TOO_OFTEN]
        return dict(sorted(often, key=lambda each: -each[1]))

    @property
    def worst_pegged(self) -> tuple[str, float] | None:
        """The highest entry of `pegged`; None without entries."""
        return max((self.pegged or {}).items(), key=lambda each: each[1], default=None)

    @classmethod
    def of(cls, samples: Sequence[LoadSample], services: WatchedServices | None = None) -> Load | None:
        """None without samples."""
        if not samples:
            return None
        watched = [sample.threads for sample in samples if sample.threads is not None]
        pegged = [name for threads in watched for name, share in threads.items() if share > LIMIT]
        return cls(
            cpu_mean=sum(sample.cpu for sample in samples) / len(samples),
            cpu_max=max(sample.cpu for sample in samples),
            saturated_share=sum(sample.cpu > LIMIT or sample.throttled for sample in samples) / len(samples),
            load_average_max=max(sample.load_average for sample in samples),
            processors=samples[-1].processors,
            pegged={name: pegged.count(name) / len(watched) for name in sorted(set(pegged))} if watched else None,
            services=services,
        )
