"""The commands `tigas trace …`. Heavy modules are imported when a command runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tigas_common.command import POSITIONAL, Command, Group, Metavar
from tigas_common.errors import TigasError
from tigas_common.terminal import make_console
from tigas_common.wire.shaper import MAX_RATE_KBPS
from tigas_shaper.traces.formats import FORMATS, load_trace
from tigas_shaper.traces.text import DEFAULT_UP_KBPS
from tigas_shaper.traces.trace import PERCENTILES, NetworkTrace, rate_percentiles

if TYPE_CHECKING:
    from tigas_shaper.traces.fetch import Source

DOWN, UP, OUTAGE = "#1f6f8b", "#d1813b", "#c0392b"
FETCH_FOLDER = Path("traces/fetched")
"""Directory of downloaded traces, with a folder for each set."""


class _RecordingCommand(Command):
    """A command that takes a recording."""

    recording: Annotated[Path, POSITIONAL]
    """Trace in any format that TIGAS reads, gzipped or not."""


class Import(_RecordingCommand):
    """Convert a recording to TIGAS's CSV format."""

    csv: Annotated[Path | None, POSITIONAL] = None
    """Output file; by default NAME.csv."""
    up: Path | None = None
    """Recording of the other direction, such as Mahimahi's .up file."""
    up_kbps: Annotated[float, Field(ge=0, le=MAX_RATE_KBPS)] = DEFAULT_UP_KBPS
    """Uplink in kbit/s if the recording has none."""
    loss_pct: Annotated[float | None, Field(ge=0, le=100)] = None
    """Random packet loss in per cent; by default the recording's own."""
    format: Annotated[str | None, Metavar("|".join(FORMATS))] = None
    """Format of the recording; by default detected."""

    def run(self) -> None:
        from tigas_shaper.traces.csv_format import format_csv

        loaded = _load(self.recording, self.up_kbps, self.format)
        if self.up:
            loaded = loaded.with_uplink(_load(self.up, self.up_kbps, self.format))
        if self.loss_pct is not None:
            loaded = loaded.with_loss(self.loss_pct)
        target = self.csv or Path(f"{loaded.name}.csv")
        try:
            with target.open("x", encoding="utf-8", newline="\n") as out:
                out.write(format_csv(loaded))
        except FileExistsError:
            raise TigasError(f"{target} exists; remove it first, or choose another file.") from None
        print(
            f"{target}: {len(loaded.times_ms):,} steps, {loaded.duration_ms / 1000:g} s, {_rate(loaded.mean_down_kbps)}"
        )


class Info(_RecordingCommand):
    """Print a trace's duration, rates and outages."""

    plot: Path | None = None
    """Also draw a plot: .png, .svg or .pdf."""

    def run(self) -> None:
        from rich.table import Table

        if self.plot and self.plot.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise TigasError(f"{self.plot}: the file name must end in .png, .svg or .pdf.")
        loaded = _load(self.recording)
        if self.plot:
            _plot(loaded, self.plot)
        gaps = loaded.outages
        facts = Table(show_header=False, box=None)
        facts.add_row("name", loaded.name)
        facts.add_row("duration", f"{loaded.duration_ms / 1000:g} s in {len(loaded.times_ms):,} steps")
        facts.add_row(
            "outages",
            f"{len(gaps)}, together {sum(length for _, length in gaps) / 1000:g} s, "
            f"the longest {max(length for _, length in gaps) / 1000:g} s"
            if gaps
            else "none",
        )
        for label, values in (
            ("one-way delay", [state.delay_ms for state in loaded.states]),
            ("jitter", [state.jitter_ms for state in loaded.states]),
        ):
            facts.add_row(label, _span(values, "ms"))
        facts.add_row("loss", _span([state.loss_pct for state in loaded.states], "%"))

        rates = Table(box=None)
        rates.add_column("Mbit/s")
        for heading in ("mean", "min", *(f"{percent} %" for percent in PERCENTILES), "max"):
            rates.add_column("median" if heading == "50 %" else heading, justify="right")
        for label, mean, kbps in (
            ("down", loaded.mean_down_kbps, loaded.down_kbps),
            ("up", loaded.mean_up_kbps, loaded.up_kbps),
        ):
            row = (mean, min(kbps), *rate_percentiles(kbps, loaded.steps_ms).values(), max(kbps))
            rates.add_row(label, *(f"{value / 1000:.2f}" for value in row))
        console = make_console()
        console.print(facts)
        console.print(rates)


class Fetch(Command):
    """Download a published set of traces; an interrupted download resumes where it stopped."""

    name: Annotated[str | None, POSITIONAL] = None
    """Name of a published set; without it, the sets are listed."""

    def run(self) -> None:
        from tigas_shaper.traces.fetch import load_sources

        known = load_sources()
        if self.name is None:
            for key, source in known.items():
                print(f"{key}: {source.title}\n    {source.page}\n    licence: {source.licence}")
            return
        if self.name not in known:
            raise TigasError(f"Unknown trace set {self.name!r}: choose one of {', '.join(known)}.")
        source = known[self.name]
        print(f"{source.title}\nlicence: {source.licence}\ncite: {source.cite}")
        for path in _fetch_files(source, FETCH_FOLDER / self.name):
            print(path)


trace = Group(
    "Inspect, convert and fetch network traces.",
    {"import": Import, "info": Info, "fetch": Fetch},
)


def _fetch_files(source: Source, directory: Path) -> Iterator[Path]:
    import httpx
    from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn

    from tigas_common.downloads import download
    from tigas_shaper.traces.fetch import MAX_BYTES, unpack

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    with httpx.Client(timeout=30) as client, Progress(*columns) as bars:
        for file in source.files:
            task = bars.add_task(file.name, total=None)

            def show(done: int, total: int | None, task: TaskID = task) -> None:
                bars.update(task, completed=done, total=total)

            path = download(file.url, file.sha256, directory / file.name, MAX_BYTES, client, show)
            if file.sha256 is None:
                bars.console.print(f"{file.name}: no known checksum, so only the transfer was checked")
            yield unpack(path) if path.suffix == ".zip" else path


def _load(path: Path, up_kbps: float = DEFAULT_UP_KBPS, format: str | None = None) -> NetworkTrace:
    if format is not None and format not in FORMATS:
        raise TigasError(f"Unknown format {format!r}: choose one of {', '.join(FORMATS)}.")
    try:
        return load_trace(path, up_kbps=up_kbps, format=format)
    except TigasError as error:
        raise TigasError(f"{path}: {error.detail}") from None


def _rate(kbps: float) -> str:
    return f"{kbps / 1000:.2f} Mbit/s"


def _span(values: list[float], unit: str) -> str:
    low, high = min(values), max(values)
    return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}"


def _plot(trace: NetworkTrace, path: Path) -> None:
    """Draw rates over time, outages, and delay and loss below them if there are any. Raises OSError."""
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
    for index, (start, length) in enumerate(trace.outages):
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
    """Unit and series of each panel below the rates, without series that are constantly 0."""
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
