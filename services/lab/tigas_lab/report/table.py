"""The table of figures, the same for the terminal, Markdown and HTML."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import groupby

from tigas_lab.configuration import MODE_NAMES
from tigas_lab.summary import Figures, Summary

NONE = "–"


@dataclass(frozen=True, slots=True)
class Column:
    """One figure of a run."""

    group: str
    title: str
    unit: str
    cell: Callable[[Figures], str]
    short: str | None = None
    """Its heading in the Markdown table, which has the most important ones alone."""

    @property
    def heading(self) -> str:
        """By itself."""
        heading = f"{self.group}: {self.title}"
        return f"{heading}, {self.unit}" if self.unit else heading


def _number(value: float | None, digits: int = 0) -> str:
    return NONE if value is None else f"{value:,.{digits}f}"


def _percent(share: float | None) -> str:
    return NONE if share is None else f"{100 * share:.1f}"


def _mbit(value: float | None) -> str:
    return NONE if value is None else f"{value / 1000:.1f}"


def _quality(figures: Figures, name: str, digits: int) -> str:
    return _number(getattr(figures.quality, name, None), digits)


def _latency(value: float | None, unanswered: int) -> str:
    return "never" if value is None and unanswered else _number(value)


LATENCY, FRAMES, BANDWIDTH = "Motion-to-photon", "Frames", "Bandwidth"
PICTURE, VIEW = "Picture", "View"
COLUMNS = (
    Column(LATENCY, "p50", "ms", lambda f: _latency(f.latencies.p50, f.latencies.unanswered), "p50, ms"),
    Column(LATENCY, "p95", "ms", lambda f: _latency(f.latencies.p95, f.latencies.unanswered), "p95, ms"),
    Column(LATENCY, "p99", "ms", lambda f: _latency(f.latencies.p99, f.latencies.unanswered), "p99, ms"),
    Column(LATENCY, "within 100 ms", "%", lambda f: _percent(f.latencies.share_interactive), "within 100 ms, %"),
    Column(FRAMES, "new views", "/s", lambda f: _number(f.frames.new_views_per_s, 1), "new views/s"),
    Column(FRAMES, "freezes", "", lambda f: f"{f.freezes.count} ({f.freezes.total_ms / 1000:.1f} s)", "freezes"),
    Column(FRAMES, "height", "px", lambda f: _number(f.mean_height), "height, px"),
    Column(BANDWIDTH, "received", "Mbit/s", lambda f: _mbit(f.received_kbps), "Mbit/s"),
    Column(BANDWIDTH, "over the link", "Mbit/s", lambda f: _mbit(f.delivered_kbps)),
    Column(PICTURE, "SSIM", "", lambda f: _quality(f, "picture_ssim", 3), "SSIM of the picture"),
    Column(PICTURE, "PSNR", "dB", lambda f: _quality(f, "picture_psnr_db", 1)),
    Column(VIEW, "SSIM", "", lambda f: _quality(f, "view_ssim", 3), "SSIM of the view"),
    Column(VIEW, "PSNR", "dB", lambda f: _quality(f, "view_psnr_db", 1)),
)


def groups() -> list[tuple[str, int]]:
    """The columns' groups, and how many columns each has."""
    return [(name, len(list(members))) for name, members in groupby(COLUMNS, lambda column: column.group)]


def label(summary: Summary) -> str:
    """The run within its network."""
    configuration = summary.record.configuration
    name = MODE_NAMES[configuration.mode]
    if configuration.mode == "stateless":
        profile = configuration.profile
        name += f", rung {profile}" if isinstance(profile, int) else f", {profile}"
    return f"{name} ({configuration.repeat + 1})" if configuration.repeat else name


def network_name(summary: Summary) -> str:
    """The run's network, with the round trip that was put in place of a trace's own."""
    network = summary.record.configuration.network
    return network.name if network.rtt_ms is None else f"{network.name}, {network.rtt_ms:g} ms round trip"


def cells(summary: Summary) -> list[str]:
    """One per column; all empty without figures."""
    figures = summary.figures
    return [column.cell(figures) if figures else NONE for column in COLUMNS]


def by_network(summaries: Iterable[Summary]) -> dict[str, list[Summary]]:
    """In the order in which they were made."""
    found: dict[str, list[Summary]] = {}
    for summary in summaries:
        found.setdefault(network_name(summary), []).append(summary)
    return found


def markdown(summaries: Iterable[Summary]) -> str:
    """One table for all networks, with the most important figures; the first three are motion-to-photon latencies."""
    chosen = [column for column in COLUMNS if column.short]
    lines = [
        "| network | mode | " + " | ".join(column.short or "" for column in chosen) + " |",
        "|---|---|" + "---:|" * len(chosen),
    ]
    for network, runs in by_network(summaries).items():
        for run in runs:
            figures = run.figures
            if figures is None:
                row = [f"no result: {run.problem}", *[""] * (len(chosen) - 1)]
            else:
                row = [column.cell(figures) for column in chosen]
            lines.append(f"| {network} | {label(run)} | " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return "\n".join(lines) + "\n"
