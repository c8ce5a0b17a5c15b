"""JSON that fits a wire model, or nearly does.

It has values of other types, absurd numbers, unknown names, deep nesting, repeated keys, lone surrogates, and
truncation.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st
from pydantic import TypeAdapter

from tests.fuzz.byte_edits import edited

MOST_CHANGES = 3
PIECES = (b"{", b"}", b"[", b"]", b",", b":", b'"', b"\\", b"null", b"NaN", b"1e999", b"\\ud800", b"\xff", b"\0", b" ")


@dataclass(frozen=True)
class Raw:
    """Verbatim text in the JSON, valid or not."""

    text: str


ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 0.5, -0.0, "", "0", "x", [], {}, [[]], [None], {"": None}, {"x": 1}),
    *(2**31, 2**53, 2**63, 2**64, -(2**63) - 1, 1e-320, 5e-324, 1e308, -1e308, 1e38, 3.5e38, 1e6, 1e9, 1e15),
    *("..", "../../etc/passwd", "\0", "a\nb", "\u202e", "é" * 300, "=cmd|' /C calc'!A0", "\x1b[2J", "x" * 300),
    *(Raw("NaN"), Raw("Infinity"), Raw("-Infinity"), Raw("1e999")),
    *(Raw("-1e999"), Raw("1" * 5000), Raw("0." + "1" * 5000)),
    *(Raw('"\\ud800"'), Raw('"\\udfff\\ud800"'), Raw('"\\u0000"')),
    *(Raw("01"), Raw("+1"), Raw("0x1"), Raw(""), Raw("/**/1")),
    *(Raw("[" * 300 + "]" * 300), Raw("[" * 7000), Raw('{"a":' * 2000), Raw('{"a":' * 150 + "1" + "}" * 150)),
    *(Raw("[" + "{}," * 2000 + "{}]"), Raw("[" + ",".join(["0"] * 5000) + "]")),
)  # fmt: skip
"""Unexpected values."""
ODD_NAMES = ("", "x", "__proto__", "__class__", "a" * 500, "a\nb\x1b[2J", "\0", "é", "1")


def dumps(value: Any) -> str:
    """JSON, with Raw in it."""
    match value:
        case Raw():
            return value.text
        case dict():
            return "{" + ",".join(f"{json.dumps(name)}:{dumps(part)}" for name, part in value.items()) + "}"
        case list() | tuple():
            return "[" + ",".join(map(dumps, value)) + "]"
    return json.dumps(value)


def bodies(kind: Any, examples: Sequence[Any]) -> st.SearchStrategy[bytes]:
    """Bodies of a request of type `kind`: examples and instances of its schema, most of them damaged."""
    known = st.sampled_from(list(examples))
    values = known | instances(kind) | st.builds(_overlaid, known, instances(kind), st.integers(0))
    texts = _changed(values).flatmap(_repeated_keys).map(str.encode)
    return texts | texts | edited(values.map(dumps).map(str.encode), PIECES)


def instances(kind: Any) -> st.SearchStrategy[Any]:
    """JSON values that the schema of a type allows; its validators may refuse some."""
    schema = TypeAdapter(kind).json_schema()
    return _of_schema(schema, schema.get("$defs", {}))


def _overlaid(example: Any, instance: Any, chosen: int) -> Any:
    """An example with some of an instance's values: bit n of `chosen` takes the nth."""
    taken = {name: value for place, (name, value) in enumerate(instance.items()) if chosen >> place & 1}
    return {**example, **taken}


@st.composite
def _changed(draw: st.DrawFn, values: st.SearchStrategy[Any]) -> Any:
    """A value with a few parts replaced, removed, repeated, or added."""
    value = json.loads(json.dumps(draw(values)))  # a copy that may be changed
    for _ in range(draw(st.integers(0, MOST_CHANGES))):
        places = list(_places(value))
        if not places:
            return copy.deepcopy(draw(st.sampled_from(ODD_VALUES)))
        container, key = draw(st.sampled_from(places))
        odd = copy.deepcopy(draw(st.sampled_from(ODD_VALUES)))
        match draw(st.sampled_from(("replace", "replace", "replace", "remove", "name", "repeat"))):
            case "replace":
                container[key] = odd
            case "remove":
                del container[key]
            case "name" if isinstance(container, dict):
                container[draw(st.sampled_from(ODD_NAMES))] = odd
            case _:
                container[key] = [container[key]] * draw(st.sampled_from((1, 2, 50)))
    return value


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every container in a value with each of its keys."""
    found: list[tuple[Any, Any]] = []
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        found += [(value, key), *_places(value[key])]
    return found


def _repeated_keys(value: Any) -> st.SearchStrategy[str]:
    """Its text; of an object, some with a key that is there twice."""
    text = dumps(value)
    if not isinstance(value, dict) or not value:
        return st.just(text)
    odd = st.sampled_from(ODD_VALUES).map(dumps)
    twice = st.builds(lambda key, part: f"{{{json.dumps(key)}:{part},{text[1:]}", st.sampled_from(list(value)), odd)
    return st.just(text) | st.just(text) | twice


def _of_schema(schema: dict[str, Any], definitions: dict[str, Any]) -> st.SearchStrategy[Any]:
    def inner(part: dict[str, Any]) -> st.SearchStrategy[Any]:
        return _of_schema(part, definitions)

    if "$ref" in schema:
        return st.deferred(lambda: inner(definitions[schema["$ref"].rpartition("/")[2]]))
    if "anyOf" in schema:
        return st.one_of(*map(inner, schema["anyOf"]))
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if "const" in schema:
        return st.just(schema["const"])
    return _TYPES[schema["type"]](schema, inner) if "type" in schema else st.none() | st.text(max_size=5)


_Inner = Callable[[dict[str, Any]], st.SearchStrategy[Any]]


def _integers(schema: dict[str, Any], inner: _Inner) -> st.SearchStrategy[Any]:
    low, high = schema.get("minimum", -(2**40)), schema.get("maximum", schema.get("exclusiveMaximum", 2**40 + 1) - 1)
    return st.integers(low, high)


def _numbers(schema: dict[str, Any], inner: _Inner) -> st.SearchStrategy[Any]:
    low, high = schema.get("minimum", schema.get("exclusiveMinimum")), schema.get("maximum")
    return st.floats(low, high, allow_nan=False, allow_infinity=False, exclude_min="exclusiveMinimum" in schema)


def _strings(schema: dict[str, Any], inner: _Inner) -> st.SearchStrategy[Any]:
    return st.text(min_size=schema.get("minLength", 0), max_size=min(schema.get("maxLength", 20), 20))


def _arrays(schema: dict[str, Any], inner: _Inner) -> st.SearchStrategy[Any]:
    if "prefixItems" in schema:
        return st.tuples(*map(inner, schema["prefixItems"])).map(list)
    return st.lists(inner(schema["items"]), min_size=schema.get("minItems", 0), max_size=schema.get("maxItems", 3))


def _objects(schema: dict[str, Any], inner: _Inner) -> st.SearchStrategy[Any]:
    if "properties" not in schema:
        return st.dictionaries(st.text(max_size=5), inner(schema.get("additionalProperties") or {}), max_size=3)
    required = set(schema.get("required", ()))
    parts = {name: inner(part) for name, part in schema["properties"].items()}
    return st.fixed_dictionaries(
        {name: part for name, part in parts.items() if name in required},
        optional={name: part for name, part in parts.items() if name not in required},
    )


_TYPES: dict[str, Callable[[dict[str, Any], _Inner], st.SearchStrategy[Any]]] = {
    "integer": _integers,
    "number": _numbers,
    "string": _strings,
    "array": _arrays,
    "object": _objects,
    "boolean": lambda schema, inner: st.booleans(),
    "null": lambda schema, inner: st.none(),
}
