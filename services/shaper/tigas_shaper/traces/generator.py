"""A seeded model of links with a wandering rate: a Markov chain of regimes, and autoregressive variation within each.

Bit for bit the same everywhere: `random.Random.random` is documented to be stable for a seed, and its numbers are
processed only with + − × ÷ and the square root, which IEEE 754 rounds exactly; no exp or log, whose last bit depends on
the C library. Rates are whole kbit/s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.trace import NetworkTrace


@dataclass(frozen=True, slots=True)
class Regime:
    """One condition of the link, such as "in coverage" or "in a fade"."""

    down_kbps: float
    """Mean rate while it lasts."""
    spread: float
    """c in rate = mean (1 + c z)² / (1 + c²), z standard normal: never negative, exact mean, slightly skewed like
    measured rates, with a coefficient of variation of √(4c² + 2c⁴) / (1 + c²), about 2c.
    """
    dwell_s: float
    """Mean time spent in it before it changes; geometrically distributed."""
    next: Mapping[str, float]
    """Probabilities of the next regime; they sum to 1."""


@dataclass(frozen=True, slots=True)
class LinkModel:
    """A link: regimes, variation within them, and constants."""

    regimes: Mapping[str, Regime]
    """By name; the first is where it starts."""
    variation: tuple[tuple[float, float], ...]
    """z as a sum of independent first-order autoregressive processes: the share of the variance and the correlation
    time in seconds of each (0 is white noise). The shares sum to 1. Continues across regimes."""
    up_share: float
    """The uplink's mean over the downlink's, in every regime; it varies with its own z."""
    delay_ms: float
    """One way."""
    jitter_ms: float
    step_ms: int


def generate(name: str, model: LinkModel, duration_ms: int, seed: int) -> NetworkTrace:
    """A trace of the model; the same for the same arguments on any machine."""
    random = Random(seed)
    step_s = model.step_ms / 1000
    down, up = (_variation(model.variation, step_s, random) for _ in range(2))
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


def _rate(mean: float, spread: float, z: float) -> int:
    root = 1 + spread * z
    return round(mean * (root * root) / (1 + spread * spread))


def _variation(parts: tuple[tuple[float, float], ...], step_s: float, random: Random) -> Callable[[], float]:
    """A stationary process of unit variance, one value a call."""
    values = [_normal(random) for _ in parts]

    def advance() -> float:
        total = 0.0
        for index, (share, tau) in enumerate(parts):
            keep = tau / (tau + step_s)  # the implicit-Euler form of exp(−step/τ): a plain division
            values[index] = keep * values[index] + math.sqrt(1 - keep * keep) * _normal(random)
            total += math.sqrt(share) * values[index]
        return total

    return advance


def _normal(random: Random) -> float:
    """Standard normal to a good approximation: twelve uniform numbers have a variance of 1 (Irwin-Hall)."""
    total = -6.0
    for _ in range(12):  # one after the other: `sum` of floats rounds differently since Python 3.12
        total += random.random()
    return total


def _choose(weights: Mapping[str, float], draw: float) -> str:
    for name, weight in weights.items():
        draw -= weight
        if draw < 0:
            return name
    return name
