"""The project's own traces in traces/network: shapes that test one property each, and stochastic links.

The data to which the stochastic ones were fitted are in docs/results/2026-11-trace-models.md. Any change here changes
the files: run `python -m tigas_shaper.traces.generator traces/network` afterwards. The model is a Markov chain of
regimes, with autoregressive variation within each. The results are identical to the bit everywhere:
`random.Random.random` is documented to be stable for a seed, and its numbers are processed only with + − × ÷ and the
square root, which IEEE 754 rounds exactly; no exp or log, whose last bit depends on the C library. Rates are whole
kbit/s.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.trace import NetworkTrace

UP_KBPS = 10_000
"""Uplink of the shapes, fast enough not to matter. They have no delay or loss either: only the rate changes."""
MINUTE_MS = 60_000


@dataclass(frozen=True, slots=True)
class Regime:
    """A state of the link, such as "in coverage" or "in a fade"."""

    down_kbps: float
    """Mean rate during the regime."""
    spread: float
    """c in rate = mean (1 + c z)² / (1 + c²), z standard normal: never negative, exact mean, slightly skewed like
    measured rates, with a coefficient of variation of √(4c² + 2c⁴) / (1 + c²), about 2c.
    """
    dwell_s: float
    """Mean duration of the regime; geometrically distributed."""
    next: Mapping[str, float]
    """Probabilities of the next regime, which sum to 1."""


@dataclass(frozen=True, slots=True)
class LinkModel:
    """A link: regimes, variation within them, and constants."""

    regimes: Mapping[str, Regime]
    """Regimes by name; the link starts in the first one."""
    variation: tuple[tuple[float, float], ...]
    """z as a sum of independent first-order autoregressive processes, each with its share of the variance and its
    correlation time in seconds (0 is white noise). The shares sum to 1. Continues across regimes."""
    up_share: float
    """Ratio of the uplink's mean to the downlink's, in every regime; it varies with its own z."""
    delay_ms: float
    """One-way delay."""
    jitter_ms: float
    step_ms: int


MOBILE_VARIATION = ((0.5, 20.0), (0.35, 1.5), (0.15, 0.0))
"""Movement through the cell, load changes and hand-overs, and scheduling."""

BUS_4G = LinkModel(
    regimes={
        "covered": Regime(26_300, 0.26, 110, {"fade": 1}),
        "fade": Regime(0, 0, 1.1, {"covered": 1}),
    },
    variation=MOBILE_VARIATION,
    up_share=0.35,
    delay_ms=25,
    jitter_ms=4,
    step_ms=100,
)
TRAIN_4G = LinkModel(
    regimes={
        "covered": Regime(24_000, 0.34, 44, {"fade": 1}),
        "fade": Regime(0, 0, 1.8, {"covered": 1}),
    },
    variation=MOBILE_VARIATION,
    up_share=0.35,
    delay_ms=30,
    jitter_ms=8,
    step_ms=100,
)
DRIVING_5G = LinkModel(
    regimes={
        "good": Regime(206_000, 0.15, 5.1, {"fair": 0.564, "lost": 0.3, "poor": 0.136}),
        "fair": Regime(81_000, 0.15, 2.2, {"good": 0.513, "poor": 0.253, "lost": 0.234}),
        "poor": Regime(14_500, 0.4, 6.8, {"lost": 0.551, "fair": 0.347, "good": 0.102}),
        "lost": Regime(80, 0.5, 2.3, {"poor": 0.876, "fair": 0.093, "good": 0.031}),
    },
    variation=((0.85, 1.5), (0.15, 0.0)),
    up_share=0.15,
    delay_ms=38,
    jitter_ms=6,
    step_ms=100,
)
DSL = LinkModel(
    regimes={
        "alone": Regime(15_500, 0.01, 40, {"shared": 1}),
        "shared": Regime(8_000, 0.06, 15, {"alone": 1}),
    },
    variation=((0.7, 10.0), (0.3, 0.0)),
    up_share=0.0645,
    delay_ms=15,
    jitter_ms=1,
    step_ms=1000,
)


def make_own_traces() -> tuple[NetworkTrace, ...]:
    teeth = [(200, 4_000 + 36_000 * step / 99) for step in range(100)]
    return (
        _make_trace("constant", [(MINUTE_MS, 20_000)]),
        _make_trace("step-down", [(30_000, 40_000), (30_000, 8_000)]),
        _make_trace("step-up", [(30_000, 8_000), (30_000, 40_000)]),
        _make_trace("cascade", [(10_000, rate) for rate in (40_000, 20_000, 10_000, 5_000, 10_000, 20_000)]),
        _make_trace("sawtooth", teeth * 3),
        _make_trace("outage", [(20_000, 20_000), (1_000, 0), (19_000, 20_000), (5_000, 0), (15_000, 20_000)]),
        # Three minutes of a slow process may be far from typical: each seed is the first, counting from 1, with which
        # mean and variation are within 5 % of the recordings'.
        generate("4g-bus", BUS_4G, 3 * MINUTE_MS, seed=46),
        generate("4g-train", TRAIN_4G, 3 * MINUTE_MS, seed=47),
        generate("5g-driving", DRIVING_5G, 3 * MINUTE_MS, seed=24),
        generate("dsl", DSL, 5 * MINUTE_MS, seed=13),
    )


def write_own_traces(directory: Path) -> list[Path]:
    """Write each trace as a CSV file named after it. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for trace in make_own_traces():
        path = directory / f"{trace.name}.csv"
        path.write_text(format_csv(trace), encoding="utf-8", newline="\n")
        paths.append(path)
    return paths


def generate(name: str, model: LinkModel, duration_ms: int, seed: int) -> NetworkTrace:
    """Generate a trace of the model; equal arguments give equal traces on any machine."""
    random = Random(seed)
    step_s = model.step_ms / 1000
    down, up = (_make_process(model.variation, step_s, random) for _ in range(2))
    current = next(iter(model.regimes))
    times = tuple(range(0, duration_ms, model.step_ms))
    states = []
    for _ in times:
        regime = model.regimes[current]
        states.append(
            LinkSetting(
                _rate(regime.down_kbps, regime.spread, down()),
                _rate(regime.down_kbps * model.up_share, regime.spread, up()),
                model.delay_ms,
                model.jitter_ms,
            )
        )
        if random.random() < step_s / regime.dwell_s:
            current = _choose(regime.next, random.random())
    return NetworkTrace(name, times, tuple(states), duration_ms)


def _make_trace(name: str, steps: list[tuple[int, float]]) -> NetworkTrace:
    """A trace of (duration in ms, kbit/s towards the client); an outage stops both directions."""
    times, time = [], 0
    for duration, _ in steps:
        times.append(time)
        time += duration
    states = tuple(LinkSetting(round(rate), UP_KBPS if rate else 0) for _, rate in steps)
    return NetworkTrace(name, tuple(times), states, time)


def _rate(mean: float, spread: float, z: float) -> int:
    root = 1 + spread * z
    return round(mean * (root * root) / (1 + spread * spread))


def _make_process(parts: tuple[tuple[float, float], ...], step_s: float, random: Random) -> Callable[[], float]:
    """A stationary process of unit variance, advanced by each call."""
    values = [_normal(random) for _ in parts]

    def advance() -> float:
        total = 0.0
        for index, (share, tau) in enumerate(parts):
            keep = tau / (tau + step_s)  # implicit-Euler form of exp(−step/τ), a plain division
            values[index] = keep * values[index] + math.sqrt(1 - keep * keep) * _normal(random)
            total += math.sqrt(share) * values[index]
        return total

    return advance


def _normal(random: Random) -> float:
    """Approximately standard normal: the sum of twelve uniform numbers has a variance of 1 (Irwin-Hall)."""
    total = -6.0
    for _ in range(12):  # in sequence, as `sum` of floats rounds differently since Python 3.12
        total += random.random()
    return total


def _choose(weights: Mapping[str, float], draw: float) -> str:
    for name, weight in weights.items():
        draw -= weight
        if draw < 0:
            return name
    return name


if __name__ == "__main__":
    print(*write_own_traces(Path(sys.argv[1])), sep="\n")
