"""Reading and writing record files: single JSON records, NDJSON lines, and the page's recordings."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from tigas_common.files import read_regular, replace_file
from tigas_common.parsing import describe_error
from tigas_experiments.wire.recording import MAX_BYTES, Recording

MAX_FILE_BYTES = 256_000_000
MAX_RECORD_BYTES = 1_000_000
"""Maximum size of a single-record file: most have a few kilobytes, a plan may have 64 KiB."""
MAX_LINE = 1_000_000
"""Maximum length of a line in characters: usually a few hundred, but a frame may have many `latencies`."""
Entry = TypeVar("Entry", bound=BaseModel)


class BrokenRecording(Exception):
    """Reason why a recording is unusable, in one sentence."""


def parse_recording(text: str | bytes) -> Recording:
    """Parse a recording from the page's JSON. Raises BrokenRecording."""
    if len(text) > MAX_BYTES:
        raise BrokenRecording(f"The recording has {len(text)} bytes; the limit is {MAX_BYTES}.")
    return _parse(text, Recording, "The page's recording cannot be used:")


def read_record(path: Path, model: type[Entry]) -> Entry:
    """Read a file with one record. Raises BrokenRecording."""
    return _parse(_read(path, MAX_RECORD_BYTES), model, f"{path} is broken:")


def write_record(path: Path, record: BaseModel) -> None:
    """Write a record atomically. Raises OSError."""
    replace_file(path, f"{record.model_dump_json(indent=2)}\n".encode())


def read_lines(path: Path, model: type[Entry], gone: str = "") -> list[Entry]:
    """Read all entries of a file, without the text `gone` that early files contain. Raises BrokenRecording."""
    entries = []
    for number, line in enumerate(_read(path, MAX_FILE_BYTES).splitlines(), 1):
        if len(line) > MAX_LINE:
            raise BrokenRecording(f"{path}, line {number} is longer than {MAX_LINE:,} characters.")
        entries.append(_parse(line.replace(gone, ""), model, f"{path}, line {number}:"))
    return entries


def write_lines(path: Path, entries: Iterable[BaseModel]) -> None:
    """Write entries, one per line. Raises OSError."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(f"{entry.model_dump_json()}\n" for entry in entries)


def _parse(text: str | bytes, model: type[Entry], where: str) -> Entry:
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise BrokenRecording(f"{where} {describe_error(error)}") from None


def _read(path: Path, limit: int) -> str:
    try:
        return read_regular(path, limit).decode("utf-8")
    except OSError as error:
        raise BrokenRecording(f"{path} cannot be read: {error.strerror or error}.") from None
    except UnicodeDecodeError:
        raise BrokenRecording(f"{path} is not text.") from None
