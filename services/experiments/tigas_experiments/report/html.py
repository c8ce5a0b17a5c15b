"""Reports as HTML, from the templates in this package."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from tigas_common.wire.run import MODE_NAMES
from tigas_experiments.records.folder import RunRecord


def streams(records: Iterable[RunRecord]) -> dict[str, str]:
    """What the DASH modes played, by their names; the first run of each tells."""
    found: dict[str, str] = {}
    for record in records:
        if record.recording is not None and record.recording.dash is not None:
            found.setdefault(MODE_NAMES[record.configuration.mode], record.recording.dash.summary)
    return found


def rendered(template: str, **values: object) -> str:
    """A template with its values, which are escaped unless they are markup."""
    environment = Environment(
        loader=PackageLoader("tigas_experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(file_name=lambda path: Path(path).name, **values)
