"""Options shared by the commands that make runs."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from tigas_common.settings import MODELS

Url = Annotated[str | None, typer.Option(help="Measure running services at this URL instead of starting the lab.")]
Scenes = Annotated[Path | None, typer.Option(help="The lab's models directory.", show_default=str(MODELS))]
Traces = Annotated[Path | None, typer.Option(help="The lab's directory of network traces.")]


def command_as_typed() -> str:
    """The command line that runs it again."""
    return shlex.join(["tigas", *sys.argv[1:]])
