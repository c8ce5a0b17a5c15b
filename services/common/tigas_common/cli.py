"""The `tigas` command: finds each installed service's subcommands through entry points."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import Annotated

import typer

from tigas_common.terminal import LogFormatter, printable

COMMANDS = "tigas.commands"
"""The entry-point group: a `typer.Typer` becomes a group of commands, a function one command."""

AllowHosts = Annotated[
    list[str] | None,
    typer.Option("--allow-host", metavar="NAME", help="Answer under this host name as well. Repeatable."),
]
"""The option of every service for its setting `allow_hosts`."""
AllowOrigins = Annotated[
    list[str] | None,
    typer.Option("--allow-origin", metavar="URL", help="Let pages of another host use the service. Repeatable."),
]
"""The same for `allow_origins`."""


@contextmanager
def in_a_sentence(*expected: type[Exception]) -> Iterator[None]:
    """Print expected errors as one sentence and exit with status 1."""
    try:
        yield
    except expected as error:
        typer.secho(printable(str(error)), err=True, fg="red")
        raise typer.Exit(1) from None


def log_to_stdout(level: int = logging.INFO) -> None:
    """Log to standard output, from this level up."""
    handler = logging.StreamHandler(sys.stdout)
    handler.setFormatter(LogFormatter("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=level, handlers=[handler])


def application() -> typer.Typer:
    """The `tigas` command with the subcommands of all installed services."""
    app = typer.Typer(
        name="tigas",
        help="Walk through 3D Gaussian Splatting scenes, one JPEG per pose over HTTP/3.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        add_completion=False,
    )
    for point in sorted(entry_points(group=COMMANDS), key=lambda point: point.name):
        command = point.load()
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=point.name)
        else:
            app.command(point.name)(command)
    return app


def main() -> None:
    """Run the `tigas` command."""
    application()()
