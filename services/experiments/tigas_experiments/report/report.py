"""Makes a report: loads the results, aggregates them, writes tables and figures, and fills the template of a page."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tigas_common.files import read_regular
from tigas_common.wire.figures import INTERACTIVE_MS
from tigas_experiments.records.folder import RunRecord, Template
from tigas_experiments.records.samples import MAX_PICTURE_BYTES
from tigas_experiments.report.comparison_page import comparison_page
from tigas_experiments.report.controllers import Controller
from tigas_experiments.report.differences import against, choose_baseline
from tigas_experiments.report.experiment_page import experiment_page
from tigas_experiments.report.gallery import gallery
from tigas_experiments.report.groups import Groups
from tigas_experiments.report.results import LADDER, Results, Told, load, sampled_runs
from tigas_experiments.report.tables import write_csv
from tigas_experiments.report.warnings import comparison_warnings, experiment_warnings, sample_warnings

PAGES = {
    "experiment": (experiment_page, experiment_warnings),
    "comparison": (comparison_page, comparison_warnings),
}


@dataclass(frozen=True, slots=True)
class Report:
    """What was written."""

    results: Results
    groups: Groups
    template: Template
    baseline: str | None
    """The name of the controller that the others were compared with; None without runs."""
    warnings: list[str]
    page: Path


def write_report(
    folder: Path,
    out: Path,
    template: Template | None = None,
    told: Told = lambda what, done, total: None,
    *,
    baseline: str | None = None,
) -> Report:
    """Report on the runs of an experiment's folder, into another folder or its own.

    Writes report.html, the CSV files, and what its template has beside them. The experiment
    says which one that is, and with which controller the others are compared, unless somebody chooses another.

    Raises StartError if it has no runs, or none of the baseline, and OSError if it cannot be written.
    """
    results = load(folder, told)
    groups = Groups.of(results.runs)
    base = choose_baseline(groups, results.experiment, baseline)
    compared = against(groups, base) if base is not None else []
    csv_files = write_csv(results, groups, compared, base, out)
    template = template or ("experiment" if results.experiment is None else results.experiment.template)
    values, warnings = PAGES[template]
    sampled = sampled_runs(results)
    told_of = [*warnings(results), *sample_warnings(sampled)]
    report = Report(results, groups, template, None if base is None else base.name, told_of, out / "report.html")
    shown = {
        "baseline": base,
        "compared": compared,
        "sampled": sampled,
        "samples": gallery(results, sampled),
        "ladder": _ladder(results.folder),
        **values(results, groups, out, told),
    }
    page = _filled(report, csv_files, shown)
    report.page.write_text(page, encoding="utf-8")
    return report


def _filled(report: Report, csv_files: Iterable[Path], values: dict[str, object]) -> str:
    """The template, with what both have and the values of its own, which are escaped unless they are markup."""
    environment = Environment(
        loader=PackageLoader("tigas_experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    records = sorted((run.record for run in report.results.runs), key=lambda record: record.started)
    return environment.get_template(f"{report.template}.html.j2").render(
        results=report.results,
        interactive_ms=f"{INTERACTIVE_MS:g}",
        warnings=report.warnings,
        csv={path.name: _download(path) for path in csv_files},
        file_name=lambda path: Path(path).name,
        first=records[0] if records else None,
        scenes=sorted({record.configuration.scene for record in records}),
        movements=sorted({Path(record.configuration.movement).name for record in records}),
        streams=_streams(records),
        **values,
    )


def _download(path: Path) -> Markup:
    """A link that has the file in it."""
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<a download="{0}" href="data:text/csv;base64,{1}">{0}</a>').format(path.name, data)


def _ladder(folder: Path) -> str | None:
    """Its picture as a data: URL; None without one."""
    try:
        data = read_regular(folder / LADDER, MAX_PICTURE_BYTES)
    except OSError:
        return None
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def _streams(records: Iterable[RunRecord]) -> dict[str, str]:
    """What the DASH modes played, by their names; the first run of each tells."""
    found: dict[str, str] = {}
    for record in records:
        if record.recording is not None and record.recording.dash is not None:
            found.setdefault(Controller.of(record.configuration).title_with_mode, record.recording.dash.summary)
    return found
