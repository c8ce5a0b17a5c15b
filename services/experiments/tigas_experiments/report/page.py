"""Writes a report's files into a folder."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from tigas_common.wire.model import WireModel
from tigas_experiments.records.folder import StoredRun
from tigas_experiments.records.recording import BrokenRecording
from tigas_experiments.records.summary import Summary, summarise
from tigas_experiments.report import plots, table
from tigas_experiments.report.html import rendered, streams
from tigas_experiments.report.moments import MomentView, moment_view
from tigas_experiments.report.variants import Look, Variant, looks


class ReportData(WireModel):
    """report.json."""

    title: str
    command: str
    """What was run, to run it again."""
    runs: tuple[Summary, ...]
    unreadable: tuple[str, ...] = ()
    """What became of runs that cannot even be told of: a sentence each."""


@dataclass(frozen=True, slots=True)
class Plot:
    """A drawing and what it shows."""

    caption: str
    svg: Markup


@dataclass(frozen=True, slots=True)
class Section:
    """The runs over one network."""

    network: str
    runs: list[Summary]
    plots: list[Plot]
    moments: list[MomentView]


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a complete run adds to a report beside its figures."""

    curve: plots.Curve
    moment: MomentView | None

    @classmethod
    def of(cls, folder: Path, summary: Summary, look: Look) -> Drawn:
        """Of a run. Raises BrokenRecording."""
        stored, label = StoredRun(folder), table.label(summary)
        return cls(plots.Curve.of(stored, label, look), moment_view(stored, label))


PLOTS = (
    ("Distribution of motion-to-photon latency; dashed: 100 ms", plots.latency_distribution),
    ("Motion-to-photon latency of each input; grey: the link's rate", plots.latency_over_time),
    ("What crossed the link towards the viewer", plots.bandwidth_over_time),
    ("Resolution on the screen", plots.height_over_time),
)


def write_report(runs: Sequence[Path], out: Path, title: str, command: str) -> ReportData:
    """report.html, report.json, table.md, headline.svg and headline.png from run folders. Raises OSError."""
    summaries: dict[Path, Summary] = {}
    unreadable: list[str] = []
    for folder in runs:
        try:
            summaries[folder] = summarise(folder)
        except BrokenRecording as error:
            unreadable.append(f"{folder.name}: there is no result. {error}")
    look = looks(Variant.of(summary.record.configuration) for summary in summaries.values())
    drawn: dict[str, list[Drawn]] = {}
    for folder, summary in summaries.items():
        if summary.figures is not None:
            with suppress(BrokenRecording):  # its figures stay
                run = Drawn.of(folder, summary, look[Variant.of(summary.record.configuration)])
                drawn.setdefault(table.network_name(summary), []).append(run)
    data = ReportData(title=title, command=command, runs=tuple(summaries.values()), unreadable=tuple(unreadable))
    (out / "report.json").write_text(data.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (out / "table.md").write_text(table.markdown(data.runs), encoding="utf-8")
    if any(drawn.values()):
        plots.headline({network: [run.curve for run in runs] for network, runs in drawn.items()}, out)
    (out / "report.html").write_text(_html(data, drawn), encoding="utf-8")
    return data


def warnings(data: ReportData) -> list[str]:
    """What a reader must know before believing the figures."""
    found = [*data.unreadable]
    for summary in data.runs:
        record = summary.record
        name = f"{table.network_name(summary)}, {table.label(summary)}"
        if summary.problem is not None:
            found.append(f"{name}: there is no result. {summary.problem}")
        elif record.load is None:
            found.append(f"{name}: the machine's load is unknown.")
        elif record.load.saturated:
            found.append(
                f"{name}: the machine's processors were saturated during {record.load.saturated_share:.0%} of the run "
                f"({record.load.cpu_mean:.0%} busy on average), so its latencies tell of the machine, too."
            )
        if record.recording is not None and record.recording.hidden:
            found.append(f"{name}: the page was hidden at some time, so that the browser may have held frames back.")
    return found


def _html(data: ReportData, drawn: dict[str, list[Drawn]]) -> str:
    sections = [
        Section(
            network,
            runs,
            # matplotlib escapes text itself
            [
                Plot(caption, Markup(draw([run.curve for run in drawn[network]])))
                for caption, draw in PLOTS
                if drawn.get(network)
            ],
            [run.moment for run in drawn.get(network, ()) if run.moment],
        )
        for network, runs in table.by_network(data.runs).items()
    ]
    complete = [run for run in data.runs if run.figures is not None]
    return rendered(
        "report.html.j2",
        data=data,
        sections=sections,
        warnings=warnings(data),
        columns=table.COLUMNS,
        groups=table.groups(),
        label=table.label,
        network_name=table.network_name,
        cells=table.cells,
        first=complete[0].record if complete else None,
        streams=streams(run.record for run in complete),
    )
