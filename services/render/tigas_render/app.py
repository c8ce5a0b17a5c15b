"""The HTTP interface: Starlette routes, nothing else. The same application is served over HTTP/1.1 and HTTP/3."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import BaseModel
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from tigas_common.errors import BodyTooLarge, InvalidRequest, TigasError, problem
from tigas_common.parsing import MAX_BODY, parse
from tigas_common.wire import Problem, RenderRequest
from tigas_render.frame import Frame
from tigas_render.service import RenderService

logger = logging.getLogger(__name__)

STATIC = Path(__file__).parent / "static"
"""Where the web client's build lies."""
BODY_TIMEOUT_S = 10
"""A body that is not complete by then is given up, in seconds."""
CLIENT_GONE = 499
"""Nobody reads this status: the client left before its answer."""


def create_app(service: RenderService) -> Starlette:
    """The application over a running service, which is its caller's to open and close."""
    app = Starlette(
        routes=[
            Route("/render", render, methods=["POST"]),
            Route("/scenes", scenes),
            Route("/scenes/{id}", scene),
            Route("/scenes/{id}/load", load, methods=["POST"]),
            Route("/scenes/{id}/unload", unload, methods=["POST"]),
            Route("/scenes/{id}/preview", preview),
            Route("/config.json", config),
            Route("/healthz", healthz),
            Route("/metrics", metrics),
        ],
        exception_handlers={TigasError: on_error, HTTPException: on_http_error, Exception: on_error},
    )
    app.state.service = service
    if STATIC.is_dir():
        # Not a mount: that would match before a wrong method of the routes above is noticed.
        app.router.default = _Client(directory=STATIC, html=True)
    return app


async def render(request: Request) -> Response:
    """One frame."""
    render_request = parse(RenderRequest, await _body(request))
    client = request.client
    name = f"{client.host}:{client.port}" if client else "unknown"
    frame = await _unless_disconnected(request, _service(request), name, render_request)
    if frame is None:
        return Response(status_code=CLIENT_GONE)
    timing = frame.timing
    about = f"seq={frame.seq}, width={frame.width}, height={frame.height}"
    return Response(
        frame.body,
        media_type=frame.content_type,
        headers={
            "Server-Timing": f"queue;dur={timing.queue}, render;dur={timing.render}, encode;dur={timing.encode}",
            "Tigas-Frame": about if frame.profile is None else f"{about}, profile={frame.profile}",
            "Cache-Control": "no-store",
            "Timing-Allow-Origin": "*",
        },
    )


async def scenes(request: Request) -> Response:
    """All scenes; `?scan=1` looks at the models directory again first."""
    registry = _service(request).registry
    if request.query_params.get("scan"):
        await registry.scan()
    return JSONResponse([info.model_dump() for info in registry.infos()])


async def scene(request: Request) -> Response:
    """One scene."""
    return _json(_service(request).registry.info(request.path_params["id"]))


async def load(request: Request) -> Response:
    """Load a scene and wait until it is loaded."""
    registry = _service(request).registry
    await registry.load(request.path_params["id"])
    return _json(registry.info(request.path_params["id"]))


async def unload(request: Request) -> Response:
    """Unload a scene as soon as nobody renders it."""
    registry = _service(request).registry
    registry.unload(request.path_params["id"])
    return _json(registry.info(request.path_params["id"]))


async def preview(request: Request) -> Response:
    """A scene's thumbnail, rendered if the scene brings none."""
    image = await _service(request).preview(request.path_params["id"])
    return Response(image.body, media_type=image.media_type, headers={"Cache-Control": "max-age=60"})


async def config(request: Request) -> Response:
    """What the page needs to know, fitted to the address that it was opened under."""
    return _json(_service(request).config(request.url.hostname or "localhost"))


async def healthz(request: Request) -> Response:
    """Whether the service runs."""
    return JSONResponse({"status": "ok"})


async def metrics(request: Request) -> Response:
    """Prometheus' text format."""
    return Response(generate_latest(_service(request).metrics.registry), media_type=CONTENT_TYPE_LATEST)


async def on_error(request: Request, error: Exception) -> Response:
    """Every failure, as problem+json; those that are our own fault are logged."""
    if not isinstance(error, TigasError):
        logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return _problem(problem(error))


async def on_http_error(request: Request, error: Exception) -> Response:
    """Starlette's own errors: unknown paths and wrong methods."""
    assert isinstance(error, HTTPException)
    if error.status_code == 405:
        detail = f"{request.url.path} does not take {request.method}."
        answer = Problem(type="tigas:method-not-allowed", title="Method not allowed", status=405, detail=detail)
    else:
        detail = f"There is nothing at {request.url.path}."
        if request.url.path == "/" and not STATIC.is_dir():
            detail = "The page is not built yet: run `make demo`, or `npm ci && npm run build` in web/."
        answer = Problem(type="tigas:not-found", title="Not found", status=error.status_code, detail=detail)
    return _problem(answer, headers=dict(error.headers or {}))


class _Client(StaticFiles):
    """The web client: hashed assets are cached for good, the page itself is asked for anew."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        hashed = path.startswith("assets/")
        response.headers["Cache-Control"] = "max-age=31536000, immutable" if hashed else "no-cache"
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response


def _service(request: Request) -> RenderService:
    service: RenderService = request.app.state.service
    return service


def _json(model: BaseModel) -> Response:
    return Response(model.model_dump_json(), media_type="application/json", headers={"Cache-Control": "no-store"})


def _problem(answer: Problem, headers: dict[str, str] | None = None) -> Response:
    return Response(answer.model_dump_json(), answer.status, headers, media_type="application/problem+json")


async def _body(request: Request) -> bytes:
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_TIMEOUT_S):
            async for part in request.stream():
                body += part
                if len(body) > MAX_BODY:
                    raise BodyTooLarge(f"The body is larger than {MAX_BODY} bytes.")
    except TimeoutError:
        raise InvalidRequest(f"The body was not complete after {BODY_TIMEOUT_S} seconds.") from None
    except ClientDisconnect:
        raise InvalidRequest("The client left before its request was complete.") from None
    return bytes(body)


async def _unless_disconnected(
    request: Request, service: RenderService, client: str, render_request: RenderRequest
) -> Frame | None:
    """The frame, or None if the client left: then the engine is told to drop it."""
    work = asyncio.create_task(service.engine.submit(client, render_request))
    gone = asyncio.create_task(_disconnected(request))
    try:
        await asyncio.wait((work, gone), return_when=asyncio.FIRST_COMPLETED)
        return work.result() if work.done() else None
    finally:
        work.cancel()
        gone.cancel()


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
