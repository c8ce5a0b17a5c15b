"""A scene's own quality ladder, from its ladder.json, strictly read."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from tigas_common.errors import InvalidRequest, TigasError
from tigas_common.files import open_regular
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire.model import Entries, WireModel
from tigas_common.wire.render import Rung

FILE = "ladder.json"
"""Its name in a scene's folder."""
MAX_RUNGS = 16


class BrokenLadder(TigasError):
    """A ladder that cannot be used."""

    status, type, title = 422, "broken-ladder", "The scene's ladder cannot be used"


class LadderFile(WireModel):
    """The content of a ladder.json, which `tigas scene ladder` writes."""

    rungs: Annotated[Entries[Rung], Field(min_length=1, max_length=MAX_RUNGS)]
    """The best first."""
    views: int | None = Field(default=None, ge=1)
    """How many views of the scene it was measured on."""
    version: str | None = Field(default=None, max_length=100)
    """Of TIGAS, when it was measured."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len({rung.name for rung in self.rungs}) < len(self.rungs):
            raise ValueError("two rungs have the same name")
        for better, worse in pairwise(self.rungs):
            if worse.expected_kb >= better.expected_kb:
                raise ValueError(f"{worse.name!r} must have smaller frames than {better.name!r} before it")
            if worse.psnr_db is not None and better.psnr_db is not None and worse.psnr_db >= better.psnr_db:
                raise ValueError(f"{worse.name!r} cannot be better than {better.name!r} before it")
        return self


def read_ladder(path: Path) -> tuple[Rung, ...] | None:
    """A ladder.json's rungs; None without such a file. Raises BrokenLadder with one sentence on the problem."""
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BODY + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BrokenLadder(f"{path.name} cannot be read: {error.strerror or error}.") from None
    if len(content) > MAX_BODY:
        raise BrokenLadder(f"{path.name} is larger than {MAX_BODY // 1024} KiB.")
    try:
        return parse(LadderFile, content).rungs
    except InvalidRequest as error:
        raise BrokenLadder(f"{path.name} is not valid: {error.detail}") from None
