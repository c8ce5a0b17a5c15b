"""Time series as they are drawn: no finer than can be seen, and comparable over the runs of a group."""

from __future__ import annotations

import numpy as np

from tigas_experiments.report.groups import Group
from tigas_experiments.report.results import Floats

BINS = 240
"""Points of a time series."""


def downloaded(link: Floats) -> Floats:
    """MB that the link could have carried by each sample."""
    spans = np.diff(link[:, 0], prepend=0.0).clip(min=0)
    total: Floats = np.cumsum(spans * link[:, 1]) / 8
    return total


def received(group: Group) -> tuple[Floats, Floats, Floats, Floats]:
    """(s, mean, least and most MB by then) over a group's runs, as far as all of them go."""
    runs = [run.received for run in group.runs if len(run.received) > 1]
    end = min(float(received[-1, 0]) for received in runs)
    # No finer than what the page counts.
    steps = min(BINS, min(len(received) for received in runs))
    every = np.linspace(0, end, max(2, steps))
    totals = np.array([np.interp(every, r[:, 0], (r[:, 1] - r[0, 1]) / 1e6) for r in runs])
    return every, totals.mean(axis=0), totals.min(axis=0), totals.max(axis=0)


def rate(times: Floats, totals: Floats, every: float) -> tuple[Floats, Floats]:
    """Middles of parts of so many seconds, and what grew in each, a second; empty of less than one part."""
    edges = np.arange(times[0], times[-1], every) if len(times) > 1 else np.empty(0)
    grown = np.diff(np.interp(edges, times, totals)) / every
    return edges[:-1] + every / 2, grown


def binned(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Medians over BINS parts of the time; as it is, if there is less."""
    if len(times) <= BINS:
        return times, values
    place = np.linspace(times[0], times[-1], BINS + 1).searchsorted(times, side="right")
    kept = np.unique(place)
    return (
        np.array([times[place == each].mean() for each in kept]),
        np.array([np.median(values[place == each]) for each in kept]),
    )
