"""Reports as HTML, from the templates in this package."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined


def rendered(template: str, **values: object) -> str:
    """A template with its values, which are escaped unless they are markup."""
    environment = Environment(
        loader=PackageLoader("tigas_lab.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(file_name=lambda path: Path(path).name, **values)
