"""Shared basis of the Starlette applications: request bodies, models, problem+json (RFC 9457) and documentation."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from tigas_common.errors import BodyTooLarge, InvalidRequest, RequestTimeout, TigasError, problem
from tigas_common.limits import IdleTimeout
from tigas_common.parsing import MAX_BODY, Message, parse, quotable
from tigas_common.wire.render import Problem

logger = logging.getLogger(__name__)

BODY_S = 10.0
"""Seconds without data after which a body is abandoned."""
BODY_BYTES_PER_S = 500.0
"""Sustained rate below which a body is abandoned."""

ARRIVAL_KEY = "arrived"
"""Key of the request's arrival time in an ASGI scope's `state`, in seconds of the monotonic clock."""
NO_STORE = {"Cache-Control": "no-store"}
"""Header of responses that must not be cached."""
JSON = "application/json"
TEXT = "text/plain"
BYTES = "application/octet-stream"
PICTURES = ("image/jpeg", "image/png", "image/webp")
HAS_IT_ALREADY = {304: "Not modified, according to `If-None-Match`."}

Model = TypeVar("Model", bound=BaseModel)
Given = TypeVar("Given")
AnyEndpoint = TypeVar("AnyEndpoint", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True, kw_only=True)
class described:
    """Decorator that documents an endpoint in the service's API description, beyond its types."""

    query: Mapping[str, str] = field(default_factory=dict)
    """Query parameters, all optional, with their meanings."""
    takes: type[Any] | tuple[str, ...] = ()
    """Type of the request's body: a message, or media types."""
    gives: type[BaseModel] | tuple[str, ...] = ()
    """Type of the response's body, unless it is a ModelResponse."""
    also: Mapping[int, str] = field(default_factory=dict)
    """Additional statuses, with their meanings."""

    def __call__(self, endpoint: AnyEndpoint) -> AnyEndpoint:
        endpoint.described = self  # type: ignore[attr-defined]
        return endpoint


class ModelResponse(Response, Generic[Given]):
    """A model, or a list of models, as uncached JSON; the type is used in the API description."""

    def __init__(self, text: str) -> None:
        super().__init__(text, media_type="application/json", headers=NO_STORE)


def json_response(model: Model) -> ModelResponse[Model]:
    return ModelResponse(model.model_dump_json())


def list_response(models: Iterable[Model]) -> ModelResponse[list[Model]]:
    return ModelResponse(f"[{','.join(model.model_dump_json() for model in models)}]")


class CachedContent:
    """Content with an ETag, not sent again to clients that have it. Hash large content in a thread."""

    def __init__(self, content: bytes, media_type: str) -> None:
        self._content = content
        self._media_type = media_type
        self._tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'

    def response(self, request: Request) -> Response:
        """The content, or 304."""
        headers = {"ETag": self._tag, "Cache-Control": "no-cache"}
        if is_not_modified(request, self._tag):
            return Response(status_code=304, headers=headers)
        return Response(self._content, media_type=self._media_type, headers=headers)


def is_not_modified(request: Request, tag: str) -> bool:
    known = [each.strip().removeprefix("W/") for each in request.headers.get("if-none-match", "").split(",")]
    return tag in known


def created_response(model: Model, location: str) -> ModelResponse[Model]:
    answer = json_response(model)
    answer.status_code = 201
    answer.headers["Location"] = location
    return answer


def problem_response(answer: Problem, headers: Mapping[str, str] | None = None) -> Response:
    return Response(answer.model_dump_json(), answer.status, headers, media_type="application/problem+json")


async def read_body(request: Request, limit: int) -> bytes:
    """Read a request's body.

    Raises BodyTooLarge over `limit` bytes, before reading more; RequestTimeout if it arrives too slowly; InvalidRequest
    if the client disconnects.
    """
    body = bytearray()
    loop = asyncio.get_running_loop()
    idle = IdleTimeout(BODY_S, BODY_BYTES_PER_S, loop.time())
    try:
        async with asyncio.timeout_at(idle.expires_at) as timeout:
            async for part in request.stream():
                body += part
                if len(body) > limit:
                    raise BodyTooLarge(f"The body is larger than {limit} bytes.")
                idle.extend(len(part), loop.time())
                timeout.reschedule(idle.expires_at)
    except TimeoutError:
        raise RequestTimeout("The request's body did not arrive in time.") from None
    except ClientDisconnect:
        raise InvalidRequest("The client disconnected before its request was complete.") from None
    return bytes(body)


async def read_message(request: Request, kind: type[Message], limit: int = MAX_BODY) -> Message:
    """Read a request's body as a wire type. Raises as `read_body` and `parse` do."""
    return parse(kind, await read_body(request, limit), limit)


@described(gives=(JSON,))
async def healthz(request: Request) -> Response:
    """Health check of a service that is healthy whenever it answers."""
    return healthy()


def healthy() -> Response:
    return JSONResponse({"status": "ok"}, headers=NO_STORE)


WORKER_POLICY = "default-src 'self'; connect-src 'self' https:"
"""Content-Security-Policy of the page's scripts, which applies to workers; allows WebTransport to any host.

It is the same for every page, since browsers cache scripts permanently.
"""


def page_policy(sources: Iterable[str]) -> str:
    """Content-Security-Policy of the page: its own origin, and connections to `sources`."""
    hosts = sorted(sources)
    sockets = [host.replace("http", "ws", 1) for host in hosts]
    return (
        "default-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; object-src 'none'; base-uri 'none'; "
        "worker-src 'self' blob:; "
        f"form-action 'none'; connect-src 'self' {' '.join((*hosts, *sockets))}; frame-src 'self' {' '.join(hosts)}"
    )


async def on_error(request: Request, error: Exception) -> Response:
    """Answer any failure with problem+json, and log unexpected ones."""
    if not isinstance(error, TigasError):
        logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return error_response(error)


def error_response(error: Exception) -> Response:
    """The answer to a failure as problem+json, with a retry time if the error has one."""
    retry_after_s = error.retry_after_s if isinstance(error, TigasError) else None
    headers = None if retry_after_s is None else {"Retry-After": str(math.ceil(retry_after_s))}
    return problem_response(problem(error), headers)


async def on_http_error(request: Request, error: Exception) -> Response:
    """Answer Starlette's own errors: unknown paths and wrong methods."""
    assert isinstance(error, HTTPException)
    path = quotable(request.url.path, 100)
    if error.status_code == 405:
        detail = f"{path} does not accept {quotable(request.method, 20)}."
        answer = Problem(type="tigas:method-not-allowed", title="Method not allowed", status=405, detail=detail)
    else:
        detail = f"There is nothing at {path}."
        answer = Problem(type="tigas:not-found", title="Not found", status=error.status_code, detail=detail)
    return problem_response(answer, error.headers)


EXCEPTION_HANDLERS: Mapping[Any, Any] = {TigasError: on_error, HTTPException: on_http_error, Exception: on_error}
"""For Starlette's `exception_handlers`."""
