"""The paper's motivating figure (its figure 1): one walk over one link, as pictures and as a download of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from tigas_common.wire.recording import PlayedDownload
from tigas_common.wire.run import LOCAL
from tigas_experiments.report.blocks import Block
from tigas_experiments.report.charts import Looks
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.plot import AREA, INK, Plot, add_legend, panel_grid, style, svg
from tigas_experiments.report.results import Run
from tigas_experiments.report.time_series import BINS, rate

EVERY_S = 0.5
"""Rates are means over so long."""


def motivation(groups: Groups) -> Plot | None:
    """Of the walk that most modes made, the largest scene's first; None if none was made both ways."""
    walks: dict[tuple[float | None, Block, int], list[Run]] = {}
    for group in groups:
        for run in group.runs:
            configuration = run.record.configuration
            walks.setdefault((group.condition.rtt_ms, Block.of(configuration), configuration.repeat), []).append(run)
    both = [runs for runs in walks.values() if any(map(_download, runs)) and not all(map(_is_local, runs))]
    if not both:
        return None
    runs = max(both, key=lambda runs: (len(runs), max(download.bytes for run in runs if (download := _download(run)))))
    with style():
        figure, panels = panel_grid(4, width=1.4, columns=2)
        rates, totals, turning, seen = panels
        _draw_link(rates, runs)
        for run in runs:
            _draw_run(run, groups.looks, rates, totals, seen)
        middles, speeds = rate(runs[0].turned[:, 0], runs[0].turned[:, 1], EVERY_S)
        turning.plot(middles, speeds, color=INK, linewidth=1)
        rates.set_title("Rate, Mbit/s")
        totals.set_title("Received by then, MB")
        turning.set_title("The walk: turning, °/s")
        seen.set_title("SSIM of what is seen (higher is better)")
        duration = runs[0].record.configuration.duration_s
        for panel in panels:
            panel.set(xlim=(0, duration), ylim=(0, None))
        for panel in panels[2:]:
            panel.set_xlabel("Time, s")
        add_legend(figure, panels)
        return Plot("motivation", _title(runs), _caption(runs), svg(figure))


def _download(run: Run) -> PlayedDownload | None:
    """What it downloaded; None of pictures, and if nothing is known of it."""
    return run.record.recording.local if _is_local(run) and run.record.recording is not None else None


def _is_local(run: Run) -> bool:
    return run.record.configuration.mode in LOCAL


def _draw_link(rates: Axes, runs: Sequence[Run]) -> None:
    link = next((run.link for run in runs if len(run.link) > 1), None)
    if link is not None:
        thin = slice(None, None, max(1, len(link) // BINS))
        rates.fill_between(
            link[thin, 0], link[thin, 1], step="post", color=AREA, linewidth=0, zorder=0, label="Link's rate"
        )


def _draw_run(run: Run, looks: Looks, rates: Axes, totals: Axes, seen: Axes) -> None:
    look = looks[run.controller]
    line: dict[str, Any] = {"label": run.controller.title_with_mode, **look.line}
    times, received = run.received[:, 0], run.received[:, 1] / 1e6
    middles, grown = rate(times, received * 8, EVERY_S)
    rates.plot(middles, grown, linewidth=1, **line)
    totals.plot(times, received, linewidth=1.4, **line)
    seen.plot(run.seen[:, 0], run.seen[:, 1], linewidth=1, marker=look.marker, markersize=2.5, **line)
    download = _download(run)
    if download is None:
        return
    if download.bytes:
        totals.axhline(download.bytes / 1e6, color=look.colour, linewidth=0.7, linestyle=":")
    for ms, filled in ((download.first_picture_ms, "none"), (download.complete_ms, look.colour)):
        if ms is not None:
            at = (download.began_ms + ms) / 1000
            totals.plot(at, _by_then(run, at), look.marker, color=look.colour, mfc=filled, markersize=7)


def _by_then(run: Run, at_s: float) -> float:
    """MB."""
    past = run.received[run.received[:, 0] <= at_s, 1]
    return float(past[-1]) / 1e6 if len(past) else 0.0


def _title(runs: Sequence[Run]) -> str:
    """What each received by the walk's end, and when a download was on the screen."""
    return "Received: " + "; ".join(_received(run) for run in runs)


def _received(run: Run) -> str:
    download = _download(run)
    text = f"{run.controller.title_with_mode} {_by_then(run, run.record.configuration.duration_s):,.1f} MB"
    if download is None:
        return text
    if download.complete_ms is not None:
        return f"{text}, all of the scene on the screen after {download.complete_ms / 1000:,.1f} s"
    if download.first_picture_ms is not None:
        return (
            f"{text} of {download.bytes / 1e6:,.1f}, the first picture after {download.first_picture_ms / 1000:,.1f} s"
        )
    return f"{text} of {download.bytes / 1e6:,.1f}, and no picture"


def _caption(runs: Sequence[Run]) -> str:
    configuration = runs[0].record.configuration
    return (
        f"One run each: {configuration.scene}, {Path(configuration.movement).name}, over {configuration.network.label}."
        f" Rates are means over {EVERY_S:g} s. Dotted: a scene's whole file. A hollow mark is the first picture of a "
        "download, a filled one all of it. Before the first picture, nothing is seen."
    )
