"""The commands `tigas trace …`. Heavy imports wait until a command runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tigas_common.cli import in_a_sentence
from tigas_common.errors import TigasError
from tigas_common.terminal import make_console
from tigas_common.wire.shaper import MAX_RATE_KBPS
from tigas_shaper.traces.combine import combine
from tigas_shaper.traces.formats import FORMATS, load_trace
from tigas_shaper.traces.text import DEFAULT_UP_KBPS
from tigas_shaper.traces.trace import NetworkTrace

if TYPE_CHECKING:
    from tigas_shaper.traces.sources import Source

trace = typer.Typer(help="Inspect, convert, fetch and generate network traces.", no_args_is_help=True)

Recording = Annotated[Path, typer.Argument(help="A trace in any format that TIGAS reads, gzipped or not.")]
UpKbps = Annotated[float, typer.Option(min=0, max=MAX_RATE_KBPS, help="Uplink in kbit/s if the recording has none.")]
Format = Annotated[
    str | None,
    typer.Option(metavar="|".join(FORMATS), help="Format of the recording.", show_default="detected from the content"),
]


@trace.command("import")
def import_(
    recording: Recording,
    csv: Annotated[Path | None, typer.Argument(help="Output file.", show_default="NAME.csv")] = None,
    up: Annotated[
        Path | None, typer.Option(help="A recording of the other direction, such as Mahimahi's .up file.")
    ] = None,
    up_kbps: UpKbps = DEFAULT_UP_KBPS,
    loss_pct: Annotated[
        float | None,
        typer.Option(min=0, max=100, help="Packets lost at random, in per cent.", show_default="the recording's own"),
    ] = None,
    format: Format = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> None:
    """Convert a recording to TIGAS's own CSV."""
    from tigas_shaper.traces.csv_format import format_csv

    with in_a_sentence(TigasError, OSError):
        loaded = _load(recording, up_kbps, format)
        if up:
            loaded = combine(loaded, _load(up, up_kbps, format))
        if loss_pct is not None:
            loaded = loaded.with_loss(loss_pct)
        target = csv or Path(f"{loaded.name}.csv")
        try:
            with target.open("w" if force else "x", encoding="utf-8", newline="\n") as out:
                out.write(format_csv(loaded))
        except FileExistsError:
            raise TigasError(f"{target} exists; use --force to overwrite it.") from None
    print(f"{target}: {len(loaded.times_ms):,} steps, {loaded.duration_ms / 1000:g} s, {_rate(loaded.mean_down_kbps)}")


@trace.command("info")
def info(recording: Recording, up_kbps: UpKbps = DEFAULT_UP_KBPS, format: Format = None) -> None:
    """Print a trace's duration, rates and outages."""
    from rich.table import Table

    from tigas_shaper.traces.summary import PERCENTILES, outages, rate_percentiles

    with in_a_sentence(TigasError, OSError):
        loaded = _load(recording, up_kbps, format)
    gaps = outages(loaded)
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


@trace.command("plot")
def plot(
    recording: Recording,
    picture: Annotated[Path, typer.Argument(help="Output image: .png, .svg or .pdf.")],
    up_kbps: UpKbps = DEFAULT_UP_KBPS,
    format: Format = None,
) -> None:
    """Plot a trace."""
    from tigas_shaper.traces.plot import plot_trace

    with in_a_sentence(TigasError, OSError):
        if picture.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise TigasError(f"{picture}: the file name must end in .png, .svg or .pdf.")
        loaded = _load(recording, up_kbps, format)
        plot_trace(loaded, picture)
    print(picture)


@trace.command("generate")
def generate(
    directory: Annotated[Path, typer.Argument(help="Output directory; existing traces are replaced.")],
) -> None:
    """Write TIGAS's own traces, as kept in traces/network."""
    from tigas_shaper.traces.own_traces import write_own_traces

    with in_a_sentence(TigasError, OSError):
        for path in write_own_traces(directory):
            print(path)


@trace.command("fetch")
def fetch(
    name: Annotated[str | None, typer.Argument(help="A published set.", show_default="list them")] = None,
    to: Annotated[Path, typer.Option(help="Directory to download to; each set gets its own folder.")] = Path(
        "traces/fetched"
    ),
    sources: Annotated[Path | None, typer.Option(help="List of sets, in TOML.", show_default="built in")] = None,
) -> None:
    """Download a published set of traces; an interrupted download resumes where it stopped."""
    from tigas_shaper.traces.sources import load_sources

    with in_a_sentence(TigasError, OSError):
        known = load_sources(sources)
        if name is None:
            for key, source in known.items():
                print(f"{key}: {source.title}\n    {source.page}\n    licence: {source.licence}")
            return
        if name not in known:
            raise TigasError(f"Unknown trace set {name!r}: choose one of {', '.join(known)}.")
        source = known[name]
        print(f"{source.title}\nlicence: {source.licence}\ncite: {source.cite}")
        for path in _fetch_files(source, to / name):
            print(path)


def _fetch_files(source: Source, directory: Path) -> Iterator[Path]:
    import httpx
    from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn

    from tigas_shaper.traces.download import download
    from tigas_shaper.traces.unpack import unpack

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    with httpx.Client(timeout=30) as client, Progress(*columns) as bars:
        for file in source.files:
            task = bars.add_task(file.name, total=None)

            def show(done: int, total: int | None, task: TaskID = task) -> None:
                bars.update(task, completed=done, total=total)

            path = download(file, directory, client, show)
            if file.sha256 is None:
                bars.console.print(f"{file.name}: no known checksum, so only the transfer was checked")
            yield unpack(path) if path.suffix == ".zip" else path


def _load(path: Path, up_kbps: float, format: str | None) -> NetworkTrace:
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
