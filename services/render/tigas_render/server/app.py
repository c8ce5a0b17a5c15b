"""The HTTP interface: Starlette routes only. The same application is served over HTTP/1.1 and HTTP/3."""

from __future__ import annotations

import asyncio
from pathlib import Path
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from tigas_common.errors import problem
from tigas_common.metrics import RequestMetrics, metrics_route, new_registry
from tigas_common.openapi import openapi
from tigas_common.origins import OriginCheck
from tigas_common.web import (
    BYTES,
    EXCEPTION_HANDLERS,
    HAS_IT_ALREADY,
    JSON,
    PICTURES,
    CachedContent,
    ModelResponse,
    created_response,
    described,
    healthy,
    json_response,
    list_response,
    problem_response,
    read_message,
)
from tigas_common.wire.render import AddedScene, HostLoad, SceneEdit, SceneInfo, SceneName, ServerConfig, Training
from tigas_render.server.frame_route import FRAME_ROUTE, PATH, HttpFrames
from tigas_render.server.page import Page
from tigas_render.server.service import RenderService
from tigas_render.uploads.routes import UPLOAD_ROUTES

STATIC = Path(__file__).parents[1] / "static"
"""Directory of the web client's build."""


def create_app(service: RenderService) -> ASGIApp:
    """Create the application for a running service, which the caller opens and closes."""
    registry = new_registry("render", *service.metrics)
    app = Starlette(
        routes=[
            openapi("Render service"),
            FRAME_ROUTE,
            Route("/scenes", scenes),
            Route("/scenes/{id}", scene),
            Route("/scenes/{id}", edit, methods=["PATCH"]),
            Route("/scenes/{id}", remove, methods=["DELETE"]),
            Route("/scenes/{id}/rename", rename, methods=["POST"]),
            Route("/scenes/{id}/load", load, methods=["POST"]),
            Route("/scenes/{id}/unload", unload, methods=["POST"]),
            Route("/scenes/{id}/preview", preview),
            Route("/scenes/{id}/download/compressed", download),
            Route("/scenes/{id}/download/streamed/{name:path}", streamed_download),
            Route("/scenes/{id}/enhance", training),
            Route("/scenes/{id}/enhance", train, methods=["POST"]),
            Route("/scenes/{id}/enhance", stop_training, methods=["DELETE"]),
            Route("/scenes/{id}/enhance.safetensors", weights),
            Route("/enhance/general.safetensors", general_weights),
            *UPLOAD_ROUTES,
            Route("/uploads/{id}/scene", add, methods=["POST"]),
            Route("/config.json", config),
            Route("/api/load", own_load),
            Route("/healthz", healthz),
            metrics_route(registry),
        ],
        exception_handlers=EXCEPTION_HANDLERS,
    )
    app.state.service = service
    app.state.settings = service.settings
    app.state.frames = HttpFrames(service, service.admission.http_viewers, service.admission.rate)
    if STATIC.is_dir():
        # Not a mount, which would match before the router could reject a wrong method for the routes above.
        app.router.default = Page(STATIC, _config)
    # The engine counts frames, including the ones it renders for other processes.
    return RequestMetrics(OriginCheck(app, service.origins), app.routes, registry, besides=PATH)


@described(query={"scan": "`1`: rescan the models directory first."})
async def scenes(request: Request) -> ModelResponse[list[SceneInfo]]:
    """All scenes."""
    service = _service(request)
    if request.query_params.get("scan"):
        await service.rescan()
    return list_response(await service.scene_infos())


async def scene(request: Request) -> ModelResponse[SceneInfo]:
    """One scene."""
    return json_response(await _service(request).scene_info(request.path_params["id"]))


async def remove(request: Request) -> Response:
    """Delete a scene's file or folder."""
    await _service(request).library.remove(request.path_params["id"])
    return Response(status_code=204)


@described(takes=SceneName)
async def rename(request: Request) -> ModelResponse[SceneInfo]:
    """Rename a scene; its name is also its id."""
    service, name = _service(request), (await read_message(request, SceneName)).name
    await service.library.rename(request.path_params["id"], name)
    return json_response(await service.scene_info(name))


@described(takes=SceneEdit)
async def edit(request: Request) -> ModelResponse[SceneInfo]:
    """Change the start view, saved views and camera paths of a scene, for everyone."""
    service, id = _service(request), request.path_params["id"]
    await service.library.edit(id, await read_message(request, SceneEdit))
    return json_response(await service.scene_info(id))


async def add(request: Request) -> ModelResponse[AddedScene]:
    """Check a complete upload, and add it as a scene."""
    id = await _service(request).library.add(request.path_params["id"])
    return created_response(AddedScene(id=id), f"/scenes/{quote(id)}")


@described(query={"coarse": "`1`: return as soon as the service can render coarse frames of it."})
async def load(request: Request) -> ModelResponse[SceneInfo]:
    """Load a scene and wait until it is loaded."""
    service, id = _service(request), request.path_params["id"]
    await service.load(id, coarse=request.query_params.get("coarse") == "1")
    return json_response(await service.scene_info(id))


async def unload(request: Request) -> ModelResponse[SceneInfo]:
    """Unload a scene that has no viewers."""
    service, id = _service(request), request.path_params["id"]
    service.registry.unload(id)
    return json_response(await service.scene_info(id))


@described(gives=PICTURES)
async def preview(request: Request) -> Response:
    """A scene's thumbnail, rendered unless the scene includes one."""
    image = await _service(request).preview(request.path_params["id"])
    return Response(image.body, media_type=image.media_type, headers={"Cache-Control": "max-age=60"})


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def download(request: Request) -> Response:
    """A scene's Gaussians as a file, made on the first request."""
    service = _service(request)
    source = service.registry.source(request.path_params["id"])
    made = await service.downloads.get(source)
    name = f"{source.id}.compressed.ply"
    return service.file_sender.response(request, made.path, made.metadata.sha256, media_type=BYTES, filename=name)


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def streamed_download(request: Request) -> Response:
    """A file of a streamed SOG scene, under its name relative to lod-meta.json."""
    service = _service(request)
    source = service.registry.source(request.path_params["id"])
    path, version = await asyncio.to_thread(service.downloads.streamed_file, source, request.path_params["name"])
    return service.file_sender.response(request, path, version)


async def training(request: Request) -> ModelResponse[Training]:
    """Progress of the training of a scene's networks."""
    return json_response(await _service(request).training(request.path_params["id"]))


async def train(request: Request) -> ModelResponse[Training]:
    """Start training a scene's networks."""
    answer = json_response(_service(request).train(request.path_params["id"]))
    answer.status_code = 202
    return answer


async def stop_training(request: Request) -> ModelResponse[Training]:
    """Stop the training; the scene keeps its previous networks."""
    return json_response(await _service(request).stop_training(request.path_params["id"]))


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def weights(request: Request) -> Response:
    """The weights of a scene's own networks."""
    service = _service(request)
    source = service.registry.source(request.path_params["id"])
    return (await asyncio.to_thread(lambda: CachedContent(service.weights.read(source), BYTES))).response(request)


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def general_weights(request: Request) -> Response:
    """The weights of the networks for any scene."""
    weights_store = _service(request).weights
    return (await asyncio.to_thread(lambda: CachedContent(weights_store.read_general(), BYTES))).response(request)


@described(query={"scene": "The scene that the page shows: `has_scene` says whether it still exists."})
async def config(request: Request) -> ModelResponse[ServerConfig]:
    """The page's configuration, for the address at which it was opened."""
    scene = request.query_params.get("scene")
    has_scene = None if scene is None else _service(request).registry.has(scene)
    return json_response(_config(request).model_copy(update={"has_scene": has_scene}))


async def own_load(request: Request) -> ModelResponse[HostLoad]:
    """The service's load, for a director that assigns viewers to hosts."""
    return json_response(_service(request).host_load(_origin(request)))


@described(gives=(JSON,))
async def healthz(request: Request) -> Response:
    """Whether the service can render: an error after the loss of its device, until the process exits."""
    lost = _service(request).engine.device_lost
    if lost.done():
        return problem_response(problem(lost.result()))
    return healthy()


def _config(request: Request) -> ServerConfig:
    return _service(request).config(_origin(request))


def _origin(request: Request) -> str:
    return f"{request.url.scheme}://{request.url.netloc}"


def _service(request: Request) -> RenderService:
    service: RenderService = request.app.state.service
    return service
