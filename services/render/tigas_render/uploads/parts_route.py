"""Parts of uploads over HTTP, with tus 1.0 (https://tus.io/protocols/resumable-upload), which resumes broken uploads.

As the only request with a large body, it is handled by the process with the client's connection; `routes` has the rest.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import wraps

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from tigas_common.errors import InvalidRequest, TigasError
from tigas_common.web import EXCEPTION_HANDLERS, NO_STORE, on_error
from tigas_render.settings import RenderSettings
from tigas_render.uploads.parts import open_uploads

PATH = "/uploads"
VERSION = "1.0.0"
CONTENT_TYPE = "application/offset+octet-stream"
WRITE_BYTES = 1 << 20
"""Number of bytes written at a time."""

Endpoint = Callable[[Request], Awaitable[Response]]


class UnsupportedTusVersion(TigasError):
    """The client does not speak tus 1.0."""

    status, type, title = 412, "other-tus-version", "This is not tus 1.0"


class NotAnUploadPart(TigasError):
    """The content type of the body is not that of a part of an upload."""

    status, type, title = 415, "not-a-part", "This is not a part of an upload"


def uploads_app(settings: RenderSettings) -> Starlette:
    """Create an application with only the route for parts."""
    app = Starlette(routes=[PART_ROUTE], exception_handlers=EXCEPTION_HANDLERS)
    app.state.settings = settings
    return app


def tus_endpoint(endpoint: Endpoint) -> Endpoint:
    """Decorate an endpoint to check the protocol version, and to add it to every answer."""

    @wraps(endpoint)
    async def answer(request: Request) -> Response:
        try:
            said = request.headers.get("tus-resumable", "")
            if said != VERSION and request.method != "OPTIONS":
                raise UnsupportedTusVersion(f"Tus-Resumable: this service supports {VERSION}, not {said[:20]!r}.")
            response = await endpoint(request)
        except TigasError as error:
            response = await on_error(request, error)
        response.headers.update({"Tus-Resumable": VERSION, "Tus-Version": VERSION, **NO_STORE})
        return response

    return answer


@tus_endpoint
async def append(request: Request) -> Response:
    """Append the next part of an upload. Received data is kept even if the connection breaks."""
    uploads, id = open_uploads(request.app.state.settings), request.path_params["id"]
    if request.headers.get("content-type") != CONTENT_TYPE:
        raise NotAnUploadPart(f"Content-Type: a part of an upload is {CONTENT_TYPE}.")
    offset = integer_header(request, "upload-offset")
    await asyncio.to_thread(uploads.append, id, offset, b"")
    async for part in _body_chunks(request):
        await asyncio.to_thread(uploads.append, id, offset, part)
        offset += len(part)
    return Response(status_code=204, headers={"Upload-Offset": str(offset)})


async def _body_chunks(request: Request) -> AsyncIterator[bytes]:
    """Yield the body in pieces to be written. It ends early if the client disconnects."""
    waiting = bytearray()
    try:
        async for part in request.stream():
            waiting += part
            if len(waiting) >= WRITE_BYTES:
                yield bytes(waiting)
                waiting.clear()
    except ClientDisconnect:
        pass
    if waiting:
        yield bytes(waiting)


def integer_header(request: Request, header: str) -> int:
    text = request.headers.get(header, "")
    if not re.fullmatch("[0-9]{1,18}", text):
        raise InvalidRequest(f"{header.title()}: {text[:30]!r} is not a number of bytes.")
    return int(text)


PART_ROUTE = Route(f"{PATH}/{{id}}", append, methods=["PATCH"])
"""The route, for an application with RenderSettings as `state.settings`."""
