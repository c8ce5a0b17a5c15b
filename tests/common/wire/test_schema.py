"""The tables of docs/protocol.md are those of the wire types: `npm run wire` writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

from tigas_common.wire.model import WireModel
from tigas_common.wire.schema import field_table, tables

PROTOCOL = Path(__file__).parents[3] / "docs/protocol.md"


class Example(WireModel):
    """A model with every kind of field."""

    name: str = Field(max_length=9)
    """A name."""
    count: int = Field(default=1, ge=0, lt=2**32)
    """A number,
    in two lines."""
    place: tuple[float, float] | None = None
    """A place."""
    form: Literal["round", "square"] = "round"
    """A choice."""


@pytest.mark.parametrize("model", tables())
def test_the_protocols_table_is_that_of_the_model(model: str) -> None:
    table = f"<!-- fields of {model} -->\n{tables()[model]}\n<!-- end -->"
    assert table in PROTOCOL.read_text(encoding="utf-8"), "cd web && npm run wire"


def test_a_table_has_each_fields_type_limits_default_and_meaning() -> None:
    assert field_table(Example).splitlines()[2:] == [
        "| `name` | string ≤ 9 characters | A name. |",
        "| `count` | integer ≥ 0, < 4,294,967,296, default 1 | A number, in two lines. |",
        "| `place` | [number, number], optional | A place. |",
        "| `form` | `round`, `square`, default `round` | A choice. |",
    ]
