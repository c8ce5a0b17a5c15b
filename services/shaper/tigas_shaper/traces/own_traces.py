"""The project's own traces in traces/network: shapes that test one thing each, and stochastic links.

The parameters of the stochastic ones, and the data they were fitted to, are in docs/network.md. Changing anything here
changes the files: run `python -m tigas_shaper.traces.own_traces traces/network` afterwards.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tigas_common.wire.shaper import LinkSetting
from tigas_shaper.traces.csv_format import format_csv
from tigas_shaper.traces.generator import LinkModel, Regime, generate
from tigas_shaper.traces.trace import NetworkTrace

UP_KBPS = 10_000
"""The shapes' uplink, fast enough not to matter. They have no delay or loss either: only the rate changes."""
MINUTE_MS = 60_000

MOBILE_VARIATION = ((0.5, 20.0), (0.35, 1.5), (0.15, 0.0))
"""Movement through the cell, changes of load and hand-overs, scheduling."""

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


def own_traces() -> tuple[NetworkTrace, ...]:
    """All of them."""
    teeth = [(200, 4_000 + 36_000 * step / 99) for step in range(100)]
    return (
        _shape("constant", [(MINUTE_MS, 20_000)]),
        _shape("step-down", [(30_000, 40_000), (30_000, 8_000)]),
        _shape("step-up", [(30_000, 8_000), (30_000, 40_000)]),
        _shape("cascade", [(10_000, rate) for rate in (40_000, 20_000, 10_000, 5_000, 10_000, 20_000)]),
        _shape("sawtooth", teeth * 3),
        _shape("outage", [(20_000, 20_000), (1_000, 0), (19_000, 20_000), (5_000, 0), (15_000, 20_000)]),
        # Three minutes of a slow process may be far from typical: each seed is the first, counting from 1, with the
        # mean and variation of the recordings within 5 %.
        generate("4g-bus", BUS_4G, 3 * MINUTE_MS, seed=46),
        generate("4g-train", TRAIN_4G, 3 * MINUTE_MS, seed=47),
        generate("5g-driving", DRIVING_5G, 3 * MINUTE_MS, seed=24),
        generate("dsl", DSL, 5 * MINUTE_MS, seed=13),
    )


def write_own_traces(directory: Path) -> list[Path]:
    """Write each as a CSV named after it. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for trace in own_traces():
        path = directory / f"{trace.name}.csv"
        path.write_text(format_csv(trace), encoding="utf-8", newline="\n")
        paths.append(path)
    return paths


def _shape(name: str, steps: list[tuple[int, float]]) -> NetworkTrace:
    """A trace of (duration in ms, kbit/s towards the client); an outage stops both directions."""
    times, time = [], 0
    for duration, _ in steps:
        times.append(time)
        time += duration
    states = tuple(LinkSetting(round(rate), UP_KBPS if rate else 0) for _, rate in steps)
    return NetworkTrace(name, tuple(times), states, time)


if __name__ == "__main__":
    print(*write_own_traces(Path(sys.argv[1])), sep="\n")
