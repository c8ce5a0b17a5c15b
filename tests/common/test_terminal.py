"""Foreign names are visible in terminals and logs, and have no effect there."""

from __future__ import annotations

import io
import logging

import pytest
from rich.table import Table

from tigas_common.cli import in_a_sentence
from tigas_common.errors import StartError
from tigas_common.terminal import LogFormatter, make_console, printable

HOSTILE = "a\x1b[2J\x1b]0;owned\x07b\rc\nd\x9be\u202ef\u2028g\x7fh\udc80i\u200bj"
SEEN = r"a\x1b[2J\x1b]0;owned\x07b\rc\nd\x9be\u202ef\u2028g\x7fh\udc80i\u200bj"


def test_what_would_act_or_hide_is_escaped_and_the_rest_stays() -> None:
    assert printable(HOSTILE) == SEEN
    assert printable("Übersicht: 20\u00a0Mbit/s ↔ 日本 😀 é") == "Übersicht: 20\u00a0Mbit/s ↔ 日本 😀 é"
    assert printable("one\ntwo\x1b", lines=True) == "one\ntwo\\x1b"


def test_a_log_has_one_line_for_each_message(capsys: pytest.CaptureFixture[str]) -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(LogFormatter("%(levelname)s %(message)s"))
    error = ValueError(HOSTILE)
    handler.handle(logging.LogRecord("x", logging.ERROR, "x.py", 1, "%s", (HOSTILE,), (ValueError, error, None)))
    first, *trace = stream.getvalue().splitlines()
    assert first == f"ERROR {SEEN}"
    assert "\x1b" not in "".join(trace)
    assert "ValueError" in "".join(trace)


def test_a_console_takes_names_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    console = make_console()
    console.file = io.StringIO()
    console.width = 300
    table = Table(title=f"[red]{HOSTILE} :smile:")
    table.add_column("[link=file:///etc/passwd]here")
    table.add_row("\x1b[31m[bold]name")
    console.print(table)
    console.print("\x1b[31m[bold]name", soft_wrap=True)
    told = console.file.getvalue()
    assert not set("\x1b\x07\r\x9b\u202e") & set(told)
    assert told.count(r"\x1b[31m[bold]name") == 2
    assert "[link=file:///etc/passwd]here" in told
    assert ":smile:" in told


def test_an_expected_error_cannot_paint_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="1"), in_a_sentence(StartError):
        raise StartError(HOSTILE)
    assert SEEN in capsys.readouterr().err
