"""What ends a long command."""

from __future__ import annotations

import signal


def end_as_ctrl_c() -> None:
    """Let SIGTERM mean what Ctrl+C means, and Ctrl+C what it always does, though a script's background jobs ignore it.

    So whatever ends a command, the current run is marked and what was started ends.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
