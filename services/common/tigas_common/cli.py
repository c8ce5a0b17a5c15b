"""The `tigas` command, which finds the commands of installed services through entry points."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import EntryPoint, distribution, entry_points
from typing import Any

from tigas_common.command import Command, Group, list_commands, parse, summary
from tigas_common.errors import StartError, TigasError, UsageError
from tigas_common.installation import PROJECT, missing_module_error
from tigas_common.terminal import LogFormatter, printable

COMMANDS = "tigas.commands"
"""Entry-point group of commands and command groups. An entry's extras are the command's dependencies."""
HELP = "Walk through 3D Gaussian Splatting scenes, one JPEG per pose over HTTP/3."


@contextmanager
def report_errors(*expected: type[Exception]) -> Iterator[None]:
    """Print expected errors as one sentence and exit with status 1."""
    try:
        yield
    except BrokenPipeError:  # from writing output: `main` handles it
        raise
    except expected as error:
        print(printable(_sentence(error)), file=sys.stderr)
        raise SystemExit(1) from None


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{os.fsdecode(error.filename)}: {error.strerror}."
    return str(error)


def log_to_stdout(level: int = logging.INFO) -> None:
    handler = logging.StreamHandler(sys.stdout)
    handler.setFormatter(LogFormatter("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=level, handlers=[handler])


def command_entry_points() -> dict[str, EntryPoint]:
    """The entry points of all installed commands and groups, by name."""
    return {point.name: point for point in sorted(entry_points(group=COMMANDS), key=lambda point: point.name)}


def load_settings(service: str, arguments: Sequence[str] = ()) -> Any:
    """The settings that a service's command would use, given these arguments. Raises UsageError."""
    return parse(command_entry_points()[service].load(), f"{PROJECT} {service}", arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    try:
        _run(sys.argv[1:] if arguments is None else arguments)
    except UsageError as error:
        print(printable(str(error)), file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the flush at exit does not fail
        raise SystemExit(1) from None


def _run(arguments: Sequence[str]) -> None:
    name, *more = arguments or ["--help"]
    points = command_entry_points()
    if name == "--version":
        print(f"{PROJECT} {distribution(PROJECT).version}")
    elif name in ("-h", "--help"):
        print(list_commands(PROJECT, HELP, {name: summary(point.load()) for name, point in points.items()}))
        raise SystemExit(0 if arguments else 2)
    elif name not in points:
        raise UsageError(f"{PROJECT} has no command {name!r}; `{PROJECT} --help` lists them.")
    else:
        _run_entry(points[name], more)


def _run_entry(point: EntryPoint, arguments: Sequence[str]) -> None:
    """Run a command. If a package is missing, report the extra that installs it."""
    try:
        command: Group | type[Command] = point.load()
        prog = f"{PROJECT} {point.name}"
        if isinstance(command, Group):
            command, prog, arguments = command.select(prog, arguments)
        with report_errors(StartError, TigasError, OSError):
            parse(command, prog, arguments).run()
    except ModuleNotFoundError as error:
        if (sentence := missing_module_error(error, point.extras)) is None:
            raise
        with report_errors(StartError):
            raise sentence from None
