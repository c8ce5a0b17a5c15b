"""`/openapi.json`: a service's API (OpenAPI 3.1), from its routes, their docstrings and their types."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from tigas_common.described import HAS_IT_ALREADY, JSON, described, description
from tigas_common.web import ModelResponse, Tagged
from tigas_common.wire.render import Problem

PATH = "/openapi.json"
REFERENCE = "#/components/schemas/{model}"

Schema = tuple[type[BaseModel], Literal["validation", "serialization"]]
"""A model, as input or as output."""
PROBLEM: Schema = (Problem, "serialization")


def openapi(name: str) -> Route:
    """The route that describes the others of its application."""

    document: asyncio.Task[Tagged] | None = None

    @described(gives=(JSON,), also=HAS_IT_ALREADY)
    async def openapi(request: Request) -> Response:
        """This service's requests and answers, as OpenAPI 3.1."""
        nonlocal document
        if document is None:  # once, in a thread: it takes up to a tenth of a second
            document = asyncio.create_task(asyncio.to_thread(_encoded, name, request.app.routes))
        return (await asyncio.shield(document)).answer(request)

    return Route(PATH, openapi)


def _encoded(name: str, routes: Iterable[BaseRoute]) -> Tagged:
    return Tagged(json.dumps(describe(name, routes), separators=(",", ":")).encode(), JSON)


def describe(name: str, routes: Iterable[BaseRoute]) -> dict[str, Any]:
    """The document."""
    described = [(route, method) for route in routes if isinstance(route, Route) for method in _methods(route)]
    models = {model for route, _ in described for model in _models(route)} | {PROBLEM}
    ordered = sorted(models, key=lambda schema: (schema[0].__name__, schema[1]))
    references, schemas = models_json_schema(ordered, ref_template=REFERENCE)
    paths: dict[str, dict[str, Any]] = {}
    for route, method in described:
        paths.setdefault(route.path_format, {})[method.lower()] = _operation(route, method, references)
    return {
        "openapi": "3.1.0",
        "info": {"title": f"TIGAS: {name}", "version": version("tigas")},
        "paths": paths,
        "components": {"schemas": schemas["$defs"]},
    }


def _operation(route: Route, method: str, references: dict[Any, dict[str, Any]]) -> dict[str, Any]:
    summary, _, rest = (inspect.getdoc(route.endpoint) or "").partition("\n")
    said = description(route.endpoint)
    text = {"type": "string"}
    operation: dict[str, Any] = {
        "operationId": f"{method.lower()}_{route.name}",
        "summary": summary,
        "parameters": [
            *({"name": name, "in": "path", "required": True, "schema": text} for name in route.param_convertors),
            *({"name": name, "in": "query", "description": what, "schema": text} for name, what in said.query.items()),
        ],
        "responses": {
            "2XX": {"description": "It is done."},
            **{str(status): {"description": what} for status, what in said.also.items()},
            "default": {
                "description": "Why it is not.",
                "content": {"application/problem+json": {"schema": references[PROBLEM]}},
            },
        },
    }
    if rest.strip():
        operation["description"] = rest.strip()
    if taken := _taken(route):
        operation["requestBody"] = {"required": True, "content": {JSON: {"schema": references[taken, "validation"]}}}
    elif isinstance(said.takes, tuple) and said.takes:
        operation["requestBody"] = {"required": True, "content": {media: {} for media in said.takes}}
    if given := _given(route):
        model, is_list = given
        schema = references[model, "serialization"]
        schema = {"type": "array", "items": schema} if is_list else schema
        operation["responses"]["2XX"]["content"] = {JSON: {"schema": schema}}
    elif isinstance(said.gives, tuple) and said.gives:
        operation["responses"]["2XX"]["content"] = {media: {} for media in said.gives}
    return operation


def _methods(route: Route) -> list[str]:
    return sorted((route.methods or set()) - {"HEAD"})


def _models(route: Route) -> Iterator[Schema]:
    if taken := _taken(route):
        yield taken, "validation"
    if given := _given(route):
        yield given[0], "serialization"


def _taken(route: Route) -> type[BaseModel] | None:
    """The model of its body, if any."""
    said = description(route.endpoint).takes
    return said if isinstance(said, type) else getattr(route.endpoint, "taken", None)


def _given(route: Route) -> tuple[type[BaseModel], bool] | None:
    """The model of its answer, or of the items of a list, if any."""
    said = description(route.endpoint).gives
    if isinstance(said, type):
        return said, False
    answer = get_type_hints(route.endpoint).get("return") if inspect.isroutine(route.endpoint) else None
    if get_origin(answer) is not ModelResponse:
        return None
    (given,) = get_args(answer)
    return (get_args(given)[0], True) if get_origin(given) is list else (given, False)
