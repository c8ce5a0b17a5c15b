"""Safe text for terminals and logs: foreign names cannot move the cursor, colour later text, or forge a line."""

from __future__ import annotations

import logging
import unicodedata
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from rich.console import Console

UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories of control and format characters, surrogates, unassigned code points, and line ends."""
_ExcInfo: TypeAlias = tuple[type[BaseException], BaseException, TracebackType | None] | tuple[None, None, None]


def printable(text: str, *, lines: bool = False) -> str:
    """With an escape for each character that would act or hide instead of being seen; `lines` keeps line feeds."""
    return "".join(
        each if unicodedata.category(each) not in UNSEEN or (lines and each == "\n") else _escaped(each)
        for each in text
    )


def make_console(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that shows text literally: without markup, emoji names or escape sequences."""
    from rich.console import Console
    from rich.text import Text

    class _Console(Console):
        def render_str(self, text: str, **arguments: Any) -> Text:
            return super().render_str(printable(text, lines=True), **arguments)

    return _Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, emoji=False, highlight=False)


class LogFormatter(logging.Formatter):
    """One line for each message; tracebacks keep theirs."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: _ExcInfo) -> str:
        """The traceback."""
        return printable(super().formatException(ei), lines=True)


def _escaped(each: str) -> str:
    return each.encode("unicode_escape").decode("ascii")
