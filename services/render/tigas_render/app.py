"""The HTTP interface: Starlette routes, nothing else. The same application is served over HTTP/1.1 and HTTP/3."""

from __future__ import annotations

import asyncio
import hashlib
from pathlib import Path
from urllib.parse import quote, urlsplit

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Scope

from tigas_common.described import BYTES, JSON, PICTURES, described
from tigas_common.errors import problem
from tigas_common.metrics import CountedRequests, metrics_route, new_registry
from tigas_common.openapi import openapi
from tigas_common.origins import OriginCheck
from tigas_common.web import (
    EXCEPTION_HANDLERS,
    Body,
    ModelResponse,
    created_response,
    has_already,
    healthy,
    json_response,
    list_response,
    page_policy,
    problem_response,
    takes,
)
from tigas_common.wire.cluster import HostLoad
from tigas_common.wire.render import AddedScene, SceneInfo, SceneName, ServerConfig, Training
from tigas_render.compressed_files import CompressedFiles
from tigas_render.frame_route import FRAMES, PATH, HttpFrames
from tigas_render.service import RenderService
from tigas_render.uploads.routes import UPLOADS

STATIC = Path(__file__).parent / "static"
"""Where the web client's build lies."""
HAS_IT_ALREADY = {304: "The client has it already, as its `If-None-Match` says."}


def create_app(service: RenderService) -> ASGIApp:
    """The application over a running service, which is its caller's to open and close."""
    registry = new_registry("render", *service.metrics)
    app = Starlette(
        routes=[
            openapi("Render service"),
            FRAMES,
            Route("/scenes", scenes),
            Route("/scenes/{id}", scene),
            Route("/scenes/{id}", remove, methods=["DELETE"]),
            Route("/scenes/{id}/rename", rename, methods=["POST"]),
            Route("/scenes/{id}/load", load, methods=["POST"]),
            Route("/scenes/{id}/unload", unload, methods=["POST"]),
            Route("/scenes/{id}/preview", preview),
            Route("/scenes/{id}/download/{form}", download),
            Route("/scenes/{id}/enhance", training),
            Route("/scenes/{id}/enhance", train, methods=["POST"]),
            Route("/scenes/{id}/enhance", stop_training, methods=["DELETE"]),
            Route("/scenes/{id}/enhance.safetensors", weights),
            Route("/enhance/general.safetensors", general_weights),
            *UPLOADS,
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
    app.state.frames = HttpFrames(service, service.http_viewers, service.rate)
    if STATIC.is_dir():
        # Not a mount: that would match before a wrong method of the routes above is noticed.
        app.router.default = _Client(directory=STATIC, html=True)
    # Frames are counted by the engine, which makes those for other processes, too.
    return CountedRequests(OriginCheck(app, service.origins), app.routes, registry, besides=PATH)


@described(query={"scan": "`1`: look at the models directory again first."})
async def scenes(request: Request) -> ModelResponse[list[SceneInfo]]:
    """All scenes."""
    service = _service(request)
    if request.query_params.get("scan"):
        await service.registry.scan()
    return list_response(await service.infos())


async def scene(request: Request) -> ModelResponse[SceneInfo]:
    """One scene."""
    return json_response(await _service(request).info(request.path_params["id"]))


async def remove(request: Request) -> Response:
    """Delete a scene's file or folder."""
    await _service(request).library.remove(request.path_params["id"])
    return Response(status_code=204)


@takes(SceneName)
async def rename(request: Request, body: Body[SceneName]) -> ModelResponse[SceneInfo]:
    """Give a scene another name, which is its id, too."""
    service, name = _service(request), (await body.read()).name
    await service.library.rename(request.path_params["id"], name)
    return json_response(await service.info(name))


async def add(request: Request) -> ModelResponse[AddedScene]:
    """Make an upload that is whole a scene, once its file has been checked."""
    id = await _service(request).library.add(request.path_params["id"])
    return created_response(AddedScene(id=id), f"/scenes/{quote(id)}")


async def load(request: Request) -> ModelResponse[SceneInfo]:
    """Load a scene and wait until it is loaded."""
    service, id = _service(request), request.path_params["id"]
    await service.load(id)
    return json_response(await service.info(id))


async def unload(request: Request) -> ModelResponse[SceneInfo]:
    """Unload a scene that nobody views."""
    service, id = _service(request), request.path_params["id"]
    service.registry.unload(id)
    return json_response(await service.info(id))


@described(gives=PICTURES)
async def preview(request: Request) -> Response:
    """A scene's thumbnail, rendered if the scene brings none."""
    image = await _service(request).preview(request.path_params["id"])
    return Response(image.body, media_type=image.media_type, headers={"Cache-Control": "max-age=60"})


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def download(request: Request) -> Response:
    """A scene's Gaussians as a file, which is made when it is first asked for."""
    service = _service(request)
    source = service.registry.source(request.path_params["id"])
    made = await service.downloads.get(source, request.path_params["form"])
    return service.readers.answer(request, source, made)


async def training(request: Request) -> ModelResponse[Training]:
    """How far the training of a scene's networks is."""
    return json_response(await _service(request).training(request.path_params["id"]))


async def train(request: Request) -> ModelResponse[Training]:
    """Start to train a scene's networks."""
    answer = json_response(_service(request).train(request.path_params["id"]))
    answer.status_code = 202
    return answer


async def stop_training(request: Request) -> ModelResponse[Training]:
    """Stop it; the scene keeps the networks that it had."""
    service, id = _service(request), request.path_params["id"]
    service.registry.source(id)
    await service.trainer.stop(id)
    return json_response(await service.training(id))


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def weights(request: Request) -> Response:
    """The weights of a scene's own networks."""
    service = _service(request)
    source = service.registry.source(request.path_params["id"])
    return _tagged(request, await asyncio.to_thread(service.shelf.content, source))


@described(gives=(BYTES,), also=HAS_IT_ALREADY)
async def general_weights(request: Request) -> Response:
    """The weights of the networks for any scene."""
    return _tagged(request, await asyncio.to_thread(_service(request).shelf.general))


@described(query={"scene": "Which it shows: `has_scene` says whether that is still there."})
async def config(request: Request) -> ModelResponse[ServerConfig]:
    """What the page needs to know, fitted to the address that it was opened under."""
    scene = request.query_params.get("scene")
    has_scene = None if scene is None else _service(request).registry.has(scene)
    return json_response(_config(request).model_copy(update={"has_scene": has_scene}))


async def own_load(request: Request) -> ModelResponse[HostLoad]:
    """How busy the service is, for whoever decides where viewers go."""
    return json_response(_service(request).host_load(_origin(request)))


@described(gives=(JSON,))
async def healthz(request: Request) -> Response:
    """Whether the service can render; after its device was lost it answers until it has stopped."""
    lost = _service(request).engine.device_lost
    if lost.done():
        return problem_response(problem(lost.result()))
    return healthy()


class _Client(CompressedFiles):
    """The web client: hashed assets are cached for good, the page itself is asked for anew."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        hashed = path.startswith("assets/")
        response.headers["Cache-Control"] = "max-age=31536000, immutable" if hashed else "no-cache"
        response.headers["Content-Security-Policy"] = _page_policy(_config(Request(scope)))
        return response


def _tagged(request: Request, content: bytes) -> Response:
    """A file that a client that has it already does not get again."""
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "no-cache"}
    if has_already(request, tag):
        return Response(status_code=304, headers=headers)
    return Response(content, media_type="application/octet-stream", headers=headers)


def _page_policy(config: ServerConfig) -> str:
    """What the page may do: only what is its own, and to speak with the services' hosts, whose ports may yet change."""
    urls = [urlsplit(url) for url in (*config.services.values(), config.webtransport_url) if url]
    # There is no way to write an IPv6 address.
    sources = (f"{url.scheme}:" if "[" in url.netloc else f"{url.scheme}://{url.hostname}:*" for url in urls)
    return page_policy(set(sources))


def _config(request: Request) -> ServerConfig:
    return _service(request).config(_origin(request))


def _origin(request: Request) -> str:
    """The page's, as it was asked for."""
    return f"{request.url.scheme}://{request.url.netloc}"


def _service(request: Request) -> RenderService:
    service: RenderService = request.app.state.service
    return service
