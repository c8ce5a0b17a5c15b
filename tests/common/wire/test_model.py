"""Properties of all wire models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import TypeAdapter

from tigas_common.wire import dash, render, shaper
from tigas_common.wire.model import WireModel
from tigas_experiments.wire import figures, recording, run, store

MODELS = [
    model
    for module in (dash, figures, recording, render, run, shaper, store)
    for model in vars(module).values()
    if isinstance(model, type) and issubclass(model, WireModel) and model is not WireModel
]


def lists(schema: Any) -> Iterator[dict[str, Any]]:
    """Every unbounded list in a core schema, except those of arbitrary JSON."""
    if isinstance(schema, dict) and "JsonValue" not in schema.get("ref", ""):
        if schema.get("type") in ("list", "set", "frozenset") or "variadic_item_index" in schema:
            yield schema
        for inside in schema.values():
            yield from lists(inside)
    elif isinstance(schema, list | tuple):
        for inside in schema:
            yield from lists(inside)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_checking_a_list_ends_at_its_first_mistake(model: type[WireModel]) -> None:
    assert all(found.get("fail_fast") for found in lists(TypeAdapter(model).core_schema))


def test_the_lists_are_found() -> None:
    assert list(lists(TypeAdapter(store.RunUpload).core_schema))
