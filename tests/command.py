"""The command `tigas` within the test's process."""

from __future__ import annotations

import io
import os
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest import mock

from tigas_common.cli import main


@dataclass(frozen=True)
class Result:
    """The outcome of a command."""

    exit_code: int
    stdout: str
    stderr: str
    output: str
    """Both, in the order in which they were printed."""


class _Stream(io.StringIO):
    def __init__(self, both: io.StringIO) -> None:
        super().__init__()
        self._both = both

    def write(self, text: str, /) -> int:
        self._both.write(text)
        return super().write(text)


def tigas(*arguments: object, columns: int = 400) -> Result:
    """Run a command to its end, in a terminal of this width."""
    both = io.StringIO()
    out, err, code = _Stream(both), _Stream(both), 0
    with redirect_stdout(out), redirect_stderr(err), mock.patch.dict(os.environ, COLUMNS=str(columns)):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    return Result(code, out.getvalue(), err.getvalue(), both.getvalue())
