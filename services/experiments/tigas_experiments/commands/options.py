"""Options shared by the commands that make runs."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

Url = Annotated[str | None, typer.Option(help="Measure running services at this URL instead of starting the lab.")]
Scenes = Annotated[Path | None, typer.Option(help="The lab's models directory.")]
Traces = Annotated[Path | None, typer.Option(help="The lab's directory of network traces.")]


def command_as_typed() -> str:
    """The command line that runs it again."""
    return shlex.join(["tigas", *sys.argv[1:]])
