"""The wire models, their generated schemas, and files shared with the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field, TypeAdapter, ValidationError

from tigas_common.parsing import parse
from tigas_common.pose import Intrinsics, Pose
from tigas_common.wire import dash, render, shaper
from tigas_common.wire.model import WireModel
from tigas_common.wire.render import RenderRequest
from tigas_common.wire.schema import field_table, tables
from tigas_common.wire.shaper import LinkSetting
from tigas_experiments.wire import figures, recording, run, store

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


LENS = Intrinsics(fx=900, fy=800, cx=640, cy=300, width=1280, height=720)


def test_a_view_is_asked_for_from_its_pose_through_its_lens() -> None:
    pose = Pose.from_euler(30, -10, 5, (1.0, 2.0, 3.0))
    sent = RenderRequest.at("courtyard", pose, LENS, profile=2, format="png")
    read = RenderRequest.model_validate_json(sent.model_dump_json(exclude_none=True))
    assert (read.scene, read.profile, read.format, read.intrinsics) == ("courtyard", 2, "png", LENS)
    assert read.pose.position == pose.position
    for ours, theirs in zip(read.pose.rotation, pose.rotation, strict=True):
        assert ours == pytest.approx(theirs, abs=1e-12)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf, -math.inf, 1.1e8])
@pytest.mark.parametrize("field", ["down_kbps", "up_kbps"])
def test_a_rate_that_no_link_has_is_refused(bad: float, field: str) -> None:
    with pytest.raises(ValidationError, match=field):
        LinkSetting(**{"down_kbps": 1, "up_kbps": 1, field: bad})


@pytest.mark.parametrize("changes", [{"delay_ms": 60_001}, {"jitter_ms": 60_001}, {"loss_pct": 100.1}])
def test_delay_jitter_and_loss_are_bounded(changes: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(changes))):
        LinkSetting(down_kbps=1, up_kbps=1, **changes)


def test_a_setting_is_read_from_json_with_whole_numbers_and_defaults() -> None:
    assert parse(LinkSetting, b'{"down_kbps": 5000, "up_kbps": 0.5}') == LinkSetting(5000, 0.5, 0, 0, 0)
