"""A report's page: one of the templates beside this file, filled."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tigas_common.wire.run import MODE_NAMES
from tigas_experiments.records.folder import RunRecord, Template
from tigas_experiments.report.results import Results


@dataclass(frozen=True, slots=True)
class Page:
    """What a template is filled with."""

    template: Template
    warnings: list[str]
    """What a reader must know before believing the figures."""
    values: dict[str, object]
    """Beside those that every template has."""

    def html(self, results: Results, csv_files: Iterable[Path]) -> str:
        """The page, in which the CSV files are, too. Values are escaped unless they are markup."""
        environment = Environment(
            loader=PackageLoader("tigas_experiments.report"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        records = sorted((run.record for run in results.runs), key=lambda record: record.started)
        return environment.get_template(f"{self.template}.html.j2").render(
            results=results,
            warnings=self.warnings,
            csv={path.name: _download(path) for path in csv_files},
            file_name=lambda path: Path(path).name,
            first=records[0] if records else None,
            scenes=sorted({record.configuration.scene for record in records}),
            movements=sorted({Path(record.configuration.movement).name for record in records}),
            streams=_streams(records),
            **self.values,
        )


def _download(path: Path) -> Markup:
    """A link that has the file in it."""
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<a download="{0}" href="data:text/csv;base64,{1}">{0}</a>').format(path.name, data)


def _streams(records: Iterable[RunRecord]) -> dict[str, str]:
    """What the DASH modes played, by their names; the first run of each tells."""
    found: dict[str, str] = {}
    for record in records:
        if record.recording is not None and record.recording.dash is not None:
            found.setdefault(MODE_NAMES[record.configuration.mode], record.recording.dash.summary)
    return found
