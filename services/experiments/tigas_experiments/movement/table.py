"""Numeric columns of CSV files: movement traces and recordings of other projects.

The text is read line by line and never split as a whole, so that a million rows need little more memory than their text
and numbers.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tigas_common.errors import StartError
from tigas_common.files import open_regular

Floats = NDArray[np.float64]

MAX_BYTES = 256_000_000
MAX_ROWS = 2_000_000
"""More than six hours at 90 poses per second."""
MAX_NUMBER = 1e100
"""The square of any smaller number is finite."""
MAX_LINE = 10_000
"""Maximum length of a line in characters; bounds the cost of splitting a hostile line."""


class MovementError(StartError):
    """Reason why a text is not a movement or cannot be imported: one sentence, with the line number if known."""


def read_text(path: Path) -> str:
    """Read a text file up to the size limit. Raises MovementError."""
    try:
        with open_regular(path) as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise MovementError(f"The movement {path} cannot be read: {error.strerror or error}.") from None
    if len(data) > MAX_BYTES:
        raise MovementError(f"{path} is larger than {MAX_BYTES // 1_000_000} MB, too large for a movement.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise MovementError(f"{path} is binary, not the text of a movement.")
    return text


class Table:
    """A CSV file: `# key: value` lines, a header, and rows of numbers. Blank lines and later comments are skipped."""

    def __init__(self, text: str, name: str) -> None:
        """name: as used in messages. Raises MovementError if the header is missing."""
        self.name = name
        self._text = text
        self.comments: dict[str, str] = {}
        """Key-value lines before the header."""
        for line, content in self._lines():
            if not content.startswith("#"):
                self._header = line
                self.columns = tuple(cell.strip() for cell in content.split(","))
                break
            key, colon, value = content.lstrip("# ").partition(":")
            if colon:
                self.comments[key.strip()] = value.strip()
        else:
            raise MovementError(f"{name} is empty.")
        if twice := next((column for column in self.columns if self.columns.count(column) > 1), None):
            raise MovementError(f"{name} has the column {twice[:40]!r} twice.")

    def read_numbers(self, columns: Sequence[str]) -> Floats:
        """Values [rows, columns], finite and with finite squares.

        Raises MovementError naming the first line that is not numeric.
        """
        for column in columns:
            if column not in self.columns:
                raise MovementError(f"{self.name} has no column {column!r}; it needs {', '.join(columns)}.")
        wanted = [self.columns.index(column) for column in columns]
        rows = (content for _, content in self._rows())
        first = next(rows, None)
        if first is None:
            raise MovementError(f"{self.name} has no poses.")
        try:
            values: Floats = np.loadtxt(
                itertools.chain([first], itertools.islice(rows, MAX_ROWS)),  # max_rows would reserve memory for all
                delimiter=",",
                usecols=wanted,
                comments=None,
                ndmin=2,
            )
        except ValueError:
            raise self._describe_broken(wanted) from None
        if len(values) > MAX_ROWS:
            raise MovementError(f"{self.name} has more than {MAX_ROWS:,} rows.")
        usable = np.abs(values) < MAX_NUMBER  # false for NaN as well
        self.reject_rows(np.logical_not(usable.all(axis=1)), "has a value that is not finite, or far too large")
        return values

    def reject_rows(self, where: NDArray[np.bool_], what: str) -> None:
        """Raise MovementError for the first row marked in `where` [rows], if any."""
        if where.any():
            wanted = int(np.argmax(where))
            line = next(itertools.islice(self._rows(), wanted, None))[0]
            raise MovementError(f"{self.name}, line {line}: the row {what}.")

    def _describe_broken(self, wanted: Sequence[int]) -> MovementError:
        """Error about the first line without numbers in the wanted columns."""
        for line, content in self._rows():
            cells = content.split(",")
            if len(cells) <= max(wanted):
                return MovementError(
                    f"{self.name}, line {line}: the row has {len(cells)} of {len(self.columns)} cells."
                )
            for index in wanted:
                try:
                    float(cells[index].replace("_", "no number"))
                except ValueError:
                    cell, column = cells[index].strip()[:30], self.columns[index]
                    return MovementError(f"{self.name}, line {line}: {column} is {cell!r}, which is not a number.")
        return MovementError(f"{self.name} has cells that are not numbers.")

    def _rows(self) -> Iterator[tuple[int, str]]:
        return (
            (line, content) for line, content in self._lines() if line > self._header and not content.startswith("#")
        )

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Number and content of each non-blank line."""
        begin, end = 0, len(self._text)
        for line in itertools.count(1):
            if begin >= end:
                return
            stop = self._text.find("\n", begin)
            stop = end if stop < 0 else stop
            if stop - begin > MAX_LINE:
                raise MovementError(f"{self.name}, line {line} is longer than {MAX_LINE:,} characters.")
            if content := self._text[begin:stop].strip():
                yield line, content
            begin = stop + 1
