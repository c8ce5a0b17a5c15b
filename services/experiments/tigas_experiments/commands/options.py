"""Options and helpers shared by the commands that make runs."""

from __future__ import annotations

import shlex
import signal
import sys
from typing import Annotated

from tigas_common.command import Command, Metavar


class Measure(Command):
    """A command that measures running services, or a lab started by it."""

    url: Annotated[str | None, Metavar("URL")] = None
    """Viewer page of running services to measure; without it, the lab is started."""


def command_as_typed() -> str:
    return shlex.join(["tigas", *sys.argv[1:]])


def end_as_ctrl_c() -> None:
    """Handle SIGTERM like Ctrl+C, and restore Ctrl+C in background jobs of scripts, so that every end cleans up."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
