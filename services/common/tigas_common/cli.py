"""The `tigas` command: finds each installed service's subcommands through entry points."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, distribution, entry_points
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from tigas_common.errors import StartError
from tigas_common.extras import PROJECT, explained
from tigas_common.terminal import LogFormatter, printable

COMMANDS = "tigas.commands"
"""The entry-point group: a `typer.Typer` becomes a group of commands, a function one command. The extras that a point
names are what its command needs."""

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


class _Commands(TyperGroup):
    """Where a package is missing, says which extra of ours brings it."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            point = next(each for each in _points() if each.name == ctx.invoked_subcommand)
            if (sentence := explained(error, point.extras)) is None:
                raise
            with in_a_sentence(StartError):
                raise sentence from None


def application() -> typer.Typer:
    """The `tigas` command with the subcommands of all installed services."""
    app = typer.Typer(
        name="tigas",
        cls=_Commands,
        help="Walk through 3D Gaussian Splatting scenes, one JPEG per pose over HTTP/3.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    for point in _points():
        command = point.load()
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=point.name)
        else:
            app.command(point.name)(command)
    return app


def _say_version(asked: bool) -> None:
    if asked:
        print(f"{PROJECT} {distribution(PROJECT).version}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_say_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """What `tigas` takes before a command."""


def _points() -> list[EntryPoint]:
    return sorted(entry_points(group=COMMANDS), key=lambda point: point.name)


def main() -> None:
    """Run the `tigas` command."""
    application()()
