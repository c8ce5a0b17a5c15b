"""JSON Schemas and field tables of the wire types, from which `npm run wire` generates TypeScript and docs.

`python -m tigas_common.wire.schema shaper` prints the schema of that name; `tables` prints the tables.
"""

from __future__ import annotations

import ast
import inspect
import json
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal

from pydantic.json_schema import models_json_schema

from tigas_common.wire import dash, render, shaper
from tigas_common.wire.model import WireModel


def messages_schema(*, requests: Sequence[type[Any]], answers: Sequence[type[WireModel]]) -> dict[str, Any]:
    """An object with one property per message; fields that a client may leave out of a request are optional."""
    validation: Literal["validation"] = "validation"
    serialization: Literal["serialization"] = "serialization"
    references, schema = models_json_schema(
        [*((model, validation) for model in requests), *((model, serialization) for model in answers)]
    )
    messages = {model.__name__: reference for (model, _), reference in references.items()}
    return {
        "title": "Messages",
        "type": "object",
        "properties": messages,
        "required": list(messages),
        "additionalProperties": False,
        "$defs": {name: _without_field_titles(definition) for name, definition in schema["$defs"].items()},
    }


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each service's messages, keyed by the name of its wire module."""
    return {
        "render": messages_schema(
            requests=[render.RenderRequest, render.SceneEdit],
            answers=[
                render.FrameHeader,
                render.Problem,
                render.SceneInfo,
                render.ServerConfig,
                render.Training,
                render.AddedScene,
            ],
        ),
        "dash": messages_schema(
            requests=[dash.SessionRequest, dash.PoseUpdate, dash.WebRtcRequest],
            answers=[
                dash.SessionInfo,
                dash.SessionStatus,
                dash.FrameShown,
                dash.WebRtcSession,
                dash.SentFrame,
            ],
        ),
        "shaper": messages_schema(
            requests=[shaper.StartRequest, shaper.SeekRequest, shaper.LoopRequest, shaper.LinkSetting],
            answers=[shaper.TraceList, shaper.TracePoints, shaper.ShaperStatus],
        ),
    }


def _without_field_titles(definition: dict[str, Any]) -> dict[str, Any]:
    """Remove pydantic's titles of fields, from which the generator would make a named type each."""
    properties = {
        name: {key: value for key, value in field.items() if key != "title"}
        for name, field in definition.get("properties", {}).items()
    }
    return {**definition, "properties": properties} if properties else definition


def tables() -> dict[str, str]:
    """The Markdown tables of fields in docs/protocol.md, keyed by model name."""
    return {model.__name__: field_table(model) for model in (render.RenderRequest, render.VideoRequest)}


def field_table(model: type[WireModel]) -> str:
    """A Markdown table of a model's fields, described by their docstrings."""
    schema, meanings = model.model_json_schema(), _field_docstrings(model)
    rows = [
        f"| `{name}` | {_type_of(field, is_optional=name not in schema.get('required', ()))} | {meanings[name]} |"
        for name, field in schema["properties"].items()
    ]
    return "\n".join(("| field | type | meaning |", "|---|---|---|", *rows))


def _field_docstrings(model: type[WireModel]) -> dict[str, str]:
    """A model's field docstrings. Pydantic could read them as well, but would do so for every model on each import."""
    (definition,) = ast.parse(inspect.getsource(model)).body
    assert isinstance(definition, ast.ClassDef)
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def _type_of(field: dict[str, Any], *, is_optional: bool) -> str:
    """A field's type, limits and default, in words."""
    present = next((each for each in field.get("anyOf", ()) if each != {"type": "null"}), field)
    match present:
        case {"$ref": str(reference)}:
            kind = reference.rpartition("/")[2]
        case {"enum": [*choices]}:
            kind = ", ".join(f"`{choice}`" for choice in choices)
        case {"prefixItems": [*items]}:
            kind = f"[{', '.join(item['type'] for item in items)}]"
        case _:
            kind = present["type"]
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "maxLength": "≤"}
    limits = ", ".join(f"{sign} {_number(present[limit])}" for limit, sign in signs.items() if limit in present)
    if limits:
        kind += f" {limits}" + (" characters" if "maxLength" in present else "")
    default = field.get("default")
    defaults = [] if default is None else [f"default {f'`{default}`' if kind[0] == '`' else json.dumps(default)}"]
    optional = ["optional"] if is_optional and not defaults else []
    return ", ".join((kind, *defaults, *optional))


def _number(value: float) -> str:
    return f"{int(value) if value == int(value) else value:,}"


if __name__ == "__main__":
    print(json.dumps(tables() if sys.argv[1] == "tables" else schemas()[sys.argv[1]], indent=2))
