"""Draws a trace: its rates over time, its outages, and its delay and loss below where it has any. Needs matplotlib."""

from __future__ import annotations

from pathlib import Path

from tigas_shaper.traces.summary import outages
from tigas_shaper.traces.trace import NetworkTrace

DOWN, UP, OUTAGE = "#1f6f8b", "#d1813b", "#c0392b"


def plot_trace(trace: NetworkTrace, path: Path) -> None:
    """Write a picture; its kind follows the suffix, such as .png or .svg. Raises OSError, and ValueError for others."""
    from matplotlib.figure import Figure

    edges = [time / 1000 for time in (*trace.times_ms, trace.duration_ms)]
    small = _small_panels(trace)
    figure = Figure(figsize=(10, 3.2 + 1.1 * len(small)), layout="constrained")
    heights = [3.0, *(1.0 for _ in small)]
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]

    rates, mean = axes[0], trace.mean_down_kbps / 1000
    down = [rate / 1000 for rate in trace.down_kbps]
    rates.stairs(down, edges, baseline=0, fill=True, color=DOWN, alpha=0.2)
    rates.stairs(down, edges, baseline=None, color=DOWN, linewidth=1, label="down")
    up = [rate / 1000 for rate in trace.up_kbps]
    rates.stairs(up, edges, baseline=None, color=UP, linewidth=1, label="up")
    rates.axhline(mean, color=DOWN, linestyle="--", linewidth=0.9, label=f"mean down {mean:.3g}")
    for index, (start, length) in enumerate(outages(trace)):
        label = "" if index else "outage"
        rates.axvspan(start / 1000, (start + length) / 1000, color=OUTAGE, alpha=0.25, linewidth=0, label=label)
    rates.set(title=trace.name, ylabel="Mbit/s", xlim=(0, edges[-1]))
    for axis, (unit, series) in zip(axes[1:], small, strict=True):
        for label, values in series.items():
            axis.stairs(values, edges, baseline=None, label=label)
        axis.set_ylabel(unit)
    for axis in axes:
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.25)
        axis.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    axes[-1].set_xlabel("s")
    figure.savefig(path, dpi=130)


def _small_panels(trace: NetworkTrace) -> list[tuple[str, dict[str, list[float]]]]:
    """Unit and series of each panel under the rates, without those that are constantly 0."""
    panels = [
        (
            "ms, one way",
            {
                "delay": [state.delay_ms for state in trace.states],
                "jitter": [state.jitter_ms for state in trace.states],
            },
        ),
        ("per cent", {"loss": [state.loss_pct for state in trace.states]}),
    ]
    return [panel for panel in panels if any(any(values) for values in panel[1].values())]
