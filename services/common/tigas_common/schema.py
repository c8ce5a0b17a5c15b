"""Prints one JSON Schema of all wire types, from which the page's TypeScript types are generated (`npm run wire`)."""

from __future__ import annotations

import json
from typing import Any

from pydantic.json_schema import models_json_schema

from tigas_common.wire import FrameHeader, Problem, RenderRequest, SceneInfo, ServerConfig


def wire_schema() -> dict[str, Any]:
    """An object with one property per message; what a client may leave out of a request is optional in it."""
    references, schema = models_json_schema(
        [
            (RenderRequest, "validation"),
            (FrameHeader, "serialization"),
            (Problem, "serialization"),
            (SceneInfo, "serialization"),
            (ServerConfig, "serialization"),
        ],
    )
    messages = {model.__name__: reference for (model, _), reference in references.items()}
    return {
        "title": "Wire",
        "description": "All messages between client and server.",
        "type": "object",
        "properties": messages,
        "required": list(messages),
        "additionalProperties": False,
        "$defs": {name: _without_field_titles(definition) for name, definition in schema["$defs"].items()},
    }


def _without_field_titles(definition: dict[str, Any]) -> dict[str, Any]:
    """Pydantic titles every field; a generator would make a named type of each."""
    properties = {
        name: {key: value for key, value in field.items() if key != "title"}
        for name, field in definition.get("properties", {}).items()
    }
    return {**definition, "properties": properties} if properties else definition


if __name__ == "__main__":
    print(json.dumps(wire_schema(), indent=2))
