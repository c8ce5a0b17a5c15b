"""The `tigas` command: it finds the subcommands of each installed service through entry points."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points

import typer

COMMANDS = "tigas.commands"
"""The entry-point group: a `typer.Typer` becomes a group of commands, a function one command."""


@contextmanager
def in_a_sentence(*expected: type[Exception]) -> Iterator[None]:
    """Turns expected errors into their sentence and exit status 1."""
    try:
        yield
    except expected as error:
        typer.secho(str(error), err=True, fg="red")
        raise typer.Exit(1) from None


def log_to_stdout(level: int = logging.INFO) -> None:
    """Write what a service logs, from this level on, to standard output."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=level, stream=sys.stdout)


def main() -> None:
    """Run the command line."""
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
    app()
