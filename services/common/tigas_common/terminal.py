"""Safe text for terminals and logs: untrusted names cannot move the cursor, change colours or forge a line."""

from __future__ import annotations

import logging
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from rich.console import Console

UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories of control and format characters, surrogates, unassigned code points and line separators."""
_ExcInfo: TypeAlias = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]


def printable(text: str, *, lines: bool = False) -> str:
    """Escape invisible and control characters; `lines` keeps line feeds."""
    return "".join(
        each if unicodedata.category(each) not in UNSEEN or (lines and each == "\n") else _escaped(each)
        for each in text
    )


def make_console(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that shows text literally, without markup, emoji names or escape sequences."""
    from rich.console import Console
    from rich.text import Text

    class _Console(Console):
        def render_str(self, text: str, **arguments: Any) -> Text:
            return super().render_str(printable(text, lines=True), **arguments)

    return _Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, emoji=False, highlight=False)


@contextmanager
def progress_bar(text: str = "") -> Iterator[Callable[[float, str], None]]:
    """Show a progress bar in a terminal. Yields a function of the progress, from 0 to 1, and the text to show."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    text_column = TextColumn("{task.description}", markup=False)
    columns = (BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeElapsedColumn(), text_column)
    console = make_console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda done, text: bar.update(task, completed=done, description=text)


class LogFormatter(logging.Formatter):
    """Formats each message on one line; tracebacks keep theirs."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return printable(super().formatMessage(record))

    def formatException(self, ei: _ExcInfo) -> str:
        return printable(super().formatException(ei), lines=True)


def _escaped(each: str) -> str:
    return each.encode("unicode_escape").decode("ascii")
