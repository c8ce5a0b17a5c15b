"""The plots of a comparison, run by run, as SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tigas_common.wire.recording import LinkSample, ShownFrame, Traffic
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.statistics import answers
from tigas_experiments.report.drawing import (
    AREA,
    NO_METADATA,
    QUIET,
    distribution,
    for_a_page,
    interactive_limit,
    legend_entries,
    plain_log,
    style,
    svg,
)
from tigas_experiments.report.variants import Look

SIZE = (7.2, 2.7)


@dataclass(frozen=True)
class Curve:
    """One run's data, ready to be drawn."""

    label: str
    look: Look
    duration_s: float
    answered: list[tuple[float, float]]
    """(s, ms): motion-to-photon latency over the time of the input; inf where no frame came."""
    link: list[LinkSample]
    frames: list[ShownFrame]
    traffic: list[Traffic]

    @classmethod
    def of(cls, run: StoredRun, label: str, look: Look) -> Curve:
        """The run as it is called. Raises BrokenRecording."""
        inputs, frames = run.inputs(), run.frames()
        configuration = run.record.configuration
        return cls(
            label=label,
            look=look,
            duration_s=configuration.duration_s,
            answered=[(entry.at / 1000, ms) for entry, ms in zip(inputs, answers(inputs, frames), strict=True)],
            link=[sample for sample in run.link() if -1000 <= sample.at <= configuration.duration_s * 1000 + 1000],
            frames=frames,
            traffic=run.traffic(),
        )

    @property
    def rates(self) -> tuple[list[float], list[float]]:
        """(s, Mbit/s) over the link; without a shaped link, what the page received."""
        if self.link:
            return [sample.at / 1000 for sample in self.link], [sample.delivered_kbps / 1000 for sample in self.link]
        pairs = [(a, b) for a, b in pairwise(self.traffic) if b.at > a.at]
        return [b.at / 1000 for _, b in pairs], [(b.bytes - a.bytes) * 8e-3 / (b.at - a.at) for a, b in pairs]


def latency_distribution(curves: Sequence[Curve]) -> str:
    """Cumulative distribution of motion-to-photon latency."""
    with style():
        figure, axes = _figure()
        draw_distribution(axes, curves)
        _legend(axes)
        return for_a_page(svg(figure))


def latency_over_time(curves: Sequence[Curve]) -> str:
    """Motion-to-photon latency over the run, the link's rate behind it."""
    with style():
        figure, axes = _figure()
        for curve in curves:
            times, values = zip(*curve.answered, strict=True) if curve.answered else ((), ())
            shown = [value if math.isfinite(value) else math.nan for value in values]
            axes.plot(times, shown, label=curve.label, **curve.look.line, linewidth=0.9)
        interactive_limit(axes)
        axes.set(xlabel="Time, s", ylabel="Motion-to-photon, ms", xlim=(0, _duration(curves)))
        plain_log(axes, [value for curve in curves for _, value in curve.answered])
        _rate_behind(axes, curves)
        _legend(axes)
        return for_a_page(svg(figure))


def bandwidth_over_time(curves: Sequence[Curve]) -> str:
    """What crossed the link towards the client, against what it could carry."""
    with style():
        figure, axes = _figure()
        link = next((curve.link for curve in curves if curve.link), [])
        if link:
            times, rates = [sample.at / 1000 for sample in link], [sample.target_kbps / 1000 for sample in link]
            axes.fill_between(times, rates, color=AREA, step="post", label="Link's rate", linewidth=0)
        for curve in curves:
            times, values = curve.rates
            axes.plot(times, values, label=curve.label, **curve.look.line, linewidth=1)
        axes.set(xlabel="Time, s", ylabel="Mbit/s", xlim=(0, _duration(curves)))
        axes.set_ylim(bottom=0)
        _legend(axes)
        return for_a_page(svg(figure))


def height_over_time(curves: Sequence[Curve]) -> str:
    """The resolution on the screen."""
    with style():
        figure, axes = _figure()
        for curve in curves:
            frames = [frame for frame in curve.frames if frame.at <= curve.duration_s * 1000]
            times = [frame.at / 1000 for frame in frames]
            axes.step(
                times,
                [frame.height for frame in frames],
                label=curve.label,
                **curve.look.line,
                where="post",
            )
        axes.set(xlabel="Time, s", ylabel="Height of the frame, pixels", xlim=(0, _duration(curves)))
        axes.set_ylim(bottom=0)
        _legend(axes)
        return for_a_page(svg(figure))


def headline(by_network: dict[str, list[Curve]], folder: Path) -> list[Path]:
    """The distributions side by side, one network each, as headline.svg and headline.png. Raises OSError."""
    with style():
        figure = Figure(figsize=(4.4 * len(by_network), 3.1), layout="constrained")
        panels = figure.subplots(1, len(by_network), squeeze=False, sharey=True)[0]
        for axes, (network, curves) in zip(panels, by_network.items(), strict=True):
            draw_distribution(axes, curves)
            axes.set_title(network, fontsize=9)
        for axes in panels[1:]:
            axes.set_ylabel("")
        by_label = legend_entries(panels)
        figure.legend(by_label.values(), by_label.keys(), loc="outside upper center", ncols=5, fontsize=8)
        paths = [folder / "headline.svg", folder / "headline.png"]
        figure.savefig(paths[0], metadata=NO_METADATA)
        figure.savefig(paths[1], dpi=160)
        return paths


def draw_distribution(axes: Axes, curves: Sequence[Curve]) -> None:
    """Share of the inputs that were on the screen within a time."""
    for curve in curves:
        values, shares = distribution([value for _, value in curve.answered])
        if values:
            axes.step(
                values,
                shares,
                where="post",
                label=curve.label,
                **curve.look.line,
                linewidth=1.6,
            )
    interactive_limit(axes, horizontal=True)
    axes.set(xlabel="Motion-to-photon latency, ms", ylabel="Share of inputs", ylim=(0, 1.01))
    plain_log(axes, [value for curve in curves for _, value in curve.answered], horizontal=True)


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=SIZE, layout="constrained")
    return figure, figure.subplots()


def _rate_behind(axes: Axes, curves: Sequence[Curve]) -> None:
    link = next((curve.link for curve in curves if curve.link), None)
    if link is None:
        return
    behind = axes.twinx()
    behind.fill_between(
        [sample.at / 1000 for sample in link],
        [sample.target_kbps / 1000 for sample in link],
        color=AREA,
        step="post",
        linewidth=0,
    )
    behind.set_ylabel("Link, Mbit/s", color=QUIET)
    behind.tick_params(axis="y", colors=QUIET)
    behind.set_ylim(bottom=0)
    behind.grid(visible=False)
    behind.spines["right"].set_visible(True)
    axes.set_zorder(behind.get_zorder() + 1)
    axes.patch.set_visible(False)


def _legend(axes: Axes) -> None:
    if legend_entries([axes]):
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, borderaxespad=0.2, handlelength=1.4, fontsize=8)


def _duration(curves: Sequence[Curve]) -> float:
    return max((curve.duration_s for curve in curves), default=1.0)
