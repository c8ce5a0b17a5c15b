"""A service's API description, from its routes, docstrings and types: OpenAPI 3.1, and an index of paths."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from tigas_common.web import HAS_IT_ALREADY, JSON, NO_STORE, TEXT, CachedContent, ModelResponse, described
from tigas_common.wire.render import Problem

PATH = "/openapi.json"
REFERENCE = "#/components/schemas/{model}"

Use = Literal["validation", "serialization"]
Schema = tuple[type[BaseModel], Use]
"""A model, as input or output."""
PROBLEM: Schema = (Problem, "serialization")
References: TypeAlias = "dict[Any, dict[str, Any]]"
Content: TypeAlias = "type[BaseModel] | type[list[BaseModel]] | tuple[str, ...]"
"""A body: a model, a list of models, or media types."""


def openapi(name: str) -> Route:
    """The route that describes the other routes of its application."""

    document: asyncio.Task[CachedContent] | None = None

    @described(gives=(JSON,), also=HAS_IT_ALREADY)
    async def openapi(request: Request) -> Response:
        """This service's requests and responses, as OpenAPI 3.1."""
        nonlocal document
        if document is None:  # once, in a thread, as it takes up to a tenth of a second
            document = asyncio.create_task(asyncio.to_thread(_encoded, name, request.app.routes))
        return (await asyncio.shield(document)).response(request)

    return Route(PATH, openapi)


def index(name: str) -> Route:
    """The index at `/` for a service without a page: its routes, each with the first line of its docstring."""

    @described(gives=(TEXT,))
    async def listing(request: Request) -> Response:
        """List of this service's routes."""
        lines = [f"{name}, TIGAS {version('tigas')}", ""]
        for route in request.app.routes:
            if isinstance(route, Route) and route.path != "/":
                lines.append(f"{'/'.join(_methods(route)):7}{route.path_format}\n       {_docstring(route)[0]}")
        return PlainTextResponse("\n".join(lines) + "\n", headers=NO_STORE)

    return Route("/", listing)


def describe(name: str, routes: Iterable[BaseRoute]) -> dict[str, Any]:
    described = [(route, method) for route in routes if isinstance(route, Route) for method in _methods(route)]
    models = {PROBLEM}
    for route, _ in described:
        bodies: dict[Use, Content] = {"validation": _documentation(route).takes, "serialization": _given(route)}
        models |= {(_model(content), use) for use, content in bodies.items() if not isinstance(content, tuple)}
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


def _encoded(name: str, routes: Iterable[BaseRoute]) -> CachedContent:
    return CachedContent(json.dumps(describe(name, routes), separators=(",", ":")).encode(), JSON)


def _operation(route: Route, method: str, references: References) -> dict[str, Any]:
    summary, rest = _docstring(route)
    documentation = _documentation(route)
    parameters: list[tuple[str, str, dict[str, str]]] = [("path", name, {}) for name in route.param_convertors]
    parameters += [("query", name, {"description": text}) for name, text in documentation.query.items()]
    operation: dict[str, Any] = {
        "operationId": f"{method.lower()}_{route.name}",
        "summary": summary,
        "parameters": [
            {"name": name, "in": place, "required": place == "path", "schema": {"type": "string"}, **more}
            for place, name, more in parameters
        ],
        "responses": {
            "2XX": {"description": "Success."},
            **{str(status): {"description": text} for status, text in documentation.also.items()},
            "default": {
                "description": "Failure.",
                "content": {"application/problem+json": {"schema": references[PROBLEM]}},
            },
        },
    }
    if rest:
        operation["description"] = rest
    if taken := documentation.takes:
        operation["requestBody"] = {"required": True, "content": _content(taken, "validation", references)}
    if given := _given(route):
        operation["responses"]["2XX"]["content"] = _content(given, "serialization", references)
    return operation


def _content(content: Content, use: str, references: References) -> dict[str, Any]:
    if isinstance(content, tuple):
        return {media: {} for media in content}
    schema = references[_model(content), use]
    return {JSON: {"schema": {"type": "array", "items": schema} if get_origin(content) is list else schema}}


def _methods(route: Route) -> list[str]:
    return sorted((route.methods or set()) - {"HEAD"})


def _docstring(route: Route) -> tuple[str, str]:
    """The first line of an endpoint's docstring, and the rest."""
    summary, _, rest = (inspect.getdoc(route.endpoint) or "").partition("\n")
    return summary, rest.strip()


def _documentation(route: Route) -> described:
    return getattr(route.endpoint, "described", None) or described()


def _given(route: Route) -> Content:
    """The body of a route's responses, if any."""
    answer = get_type_hints(route.endpoint).get("return") if inspect.isroutine(route.endpoint) else None
    return get_args(answer)[0] if get_origin(answer) is ModelResponse else _documentation(route).gives


def _model(content: Any) -> type[BaseModel]:
    """The model itself, or the one in a list."""
    model: type[BaseModel] = get_args(content)[0] if get_origin(content) is list else content
    return model
