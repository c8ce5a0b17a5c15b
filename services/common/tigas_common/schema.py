"""JSON Schemas of wire types, from which the page's TypeScript types are generated (`npm run wire`).

Run as a program it prints the schema of all messages that every client needs.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal

from pydantic.json_schema import models_json_schema

from tigas_common.wire import FrameHeader, Problem, RenderRequest, SceneInfo, ServerConfig, WireModel


def messages_schema(
    title: str, description: str, *, requests: Sequence[type[WireModel]], answers: Sequence[type[WireModel]]
) -> dict[str, Any]:
    """An object with one property per message; what a client may leave out of a request is optional in it."""
    validation: Literal["validation"] = "validation"
    serialization: Literal["serialization"] = "serialization"
    references, schema = models_json_schema(
        [*((model, validation) for model in requests), *((model, serialization) for model in answers)]
    )
    messages = {model.__name__: reference for (model, _), reference in references.items()}
    return {
        "title": title,
        "description": description,
        "type": "object",
        "properties": messages,
        "required": list(messages),
        "additionalProperties": False,
        "$defs": {name: _without_field_titles(definition) for name, definition in schema["$defs"].items()},
    }


def wire_schema() -> dict[str, Any]:
    """The messages between client and server."""
    return messages_schema(
        "Wire",
        "All messages between client and server.",
        requests=[RenderRequest],
        answers=[FrameHeader, Problem, SceneInfo, ServerConfig],
    )


def _without_field_titles(definition: dict[str, Any]) -> dict[str, Any]:
    """Pydantic titles every field; a generator would make a named type of each."""
    properties = {
        name: {key: value for key, value in field.items() if key != "title"}
        for name, field in definition.get("properties", {}).items()
    }
    return {**definition, "properties": properties} if properties else definition


if __name__ == "__main__":
    print(json.dumps(wire_schema(), indent=2))
