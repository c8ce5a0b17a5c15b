"""The list of published trace sets that can be fetched: data in sources.toml, validated on reading."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path
from urllib.parse import unquote, urlsplit

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from tigas_common.errors import TigasError

_SAFE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=-]{0,99}")


class FetchError(TigasError):
    """A published set cannot be fetched."""

    status, type, title = 502, "fetch-failed", "The data cannot be fetched"


class SourceFile(BaseModel):
    """One file of a set."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str
    sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    """Checksum of the served file; None where none has been published or verified."""

    @property
    def name(self) -> str:
        """File name on disk: the last part of its URL."""
        return unquote(urlsplit(self.url).path).rpartition("/")[2]


class Source(BaseModel):
    """A published set."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    page: str
    licence: str
    cite: str
    files: tuple[SourceFile, ...] = Field(min_length=1)


def load_sources(path: Path | None = None) -> dict[str, Source]:
    """The sets by name, from a TOML file or the list that TIGAS brings. Raises FetchError and OSError."""
    text = path.read_text("utf-8") if path else files("tigas_shaper.traces").joinpath("sources.toml").read_text("utf-8")
    try:
        sources = TypeAdapter(dict[str, Source]).validate_python(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        raise FetchError(f"The list of trace sets cannot be read: {str(error).splitlines()[0]}.") from None
    for name, source in sources.items():
        for part in (name, *(file.name for file in source.files)):
            if not _SAFE_NAME.fullmatch(part):
                raise FetchError(f"{part[:60]!r} in the list of trace sets cannot be the name of a file.")
        for file in source.files:
            if urlsplit(file.url).scheme not in ("http", "https"):
                raise FetchError(f"{file.url[:100]!r} in the list of trace sets is not an HTTP address.")
    return sources
