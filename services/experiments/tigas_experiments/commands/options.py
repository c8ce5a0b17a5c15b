"""Helpers shared by the commands that make runs."""

from __future__ import annotations

import shlex
import signal
import sys


def command_as_typed() -> str:
    return shlex.join(["tigas", *sys.argv[1:]])


def end_as_ctrl_c() -> None:
    """Handle SIGTERM like Ctrl+C, and restore Ctrl+C in background jobs of scripts, so that every end cleans up."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
